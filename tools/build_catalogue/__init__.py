"""Rebuild the shipped tables of ``catalogs/data``: ``python -m tools.build_catalogue.build``."""
