"""Scans with poses, and how training and evaluation draw groups and pairs from them."""
