"""Benchmarks: each writes a table and a flat JSON; never run as tests."""
