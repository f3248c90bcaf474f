"""Builders of the shipped tables, run by :mod:`tools.build_catalogue.build` only; nothing here is imported at run time.

A builder is a public module of this folder (no leading underscore) with

``SOURCES : tuple[SourcePackage, ...]``
    the pinned archives that it reads (see :mod:`tools.build_catalogue.sources`), and
``build(sources, out_dir) -> list[ProvenanceEntry]``
    which reads them through ``sources.read(package, path)`` and writes plain file names into ``out_dir``.

It returns one entry per file written. The bytes written must depend on the archives alone: no clock, no host,
no dictionary order of unordered inputs, no compressed stream with a time stamp.
"""
