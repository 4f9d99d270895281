"""Compiled twins of the sparse operations: optional, built on first use, equal to torch's."""
