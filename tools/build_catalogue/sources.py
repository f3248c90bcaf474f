"""Pinned archives that the shipped tables are derived from: types, verification, and the list itself.

Each archive is named by ecosystem, package, version and sha256, and each file read from it by path, sha256,
licence, citation and vintage. Nothing is read from an archive without both checks passing.

Only :mod:`tools.build_catalogue.build` needs this module; the loaders never do.
"""

import hashlib
import io
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from cpic_core import InputError


@dataclass(frozen=True)
class SourceFile:
    """One file inside an archive.

    Parameters
    ----------
    path : str
        Path inside the archive, exactly as stored there.
    sha256 : str
        Digest of the file's bytes.
    licence : str
        Licence or terms of the *content* (the package's own licence is in :class:`SourcePackage`).
    citation : str
        What to cite when results depend on it.
    vintage : str
        Date or epoch of the content, in words.
    """

    path: str
    sha256: str
    licence: str
    citation: str
    vintage: str


@dataclass(frozen=True)
class SourcePackage:
    """One released archive.

    Parameters
    ----------
    name, version : str
        Package name and exact version.
    ecosystem : {"pypi", "npm"}
        Which package client fetches it.
    archive : str
        File name of the archive.
    sha256 : str
        Digest of the archive.
    licence : str
        Licence of the package.
    files : tuple of SourceFile
        The files read from it.
    """

    name: str
    version: str
    ecosystem: str
    archive: str
    sha256: str
    licence: str
    files: tuple[SourceFile, ...]

    def file(self, path: str) -> SourceFile:
        """Return the manifest line of one file; `KeyError` if it is not pinned."""
        for item in self.files:
            if item.path == path:
                return item
        raise KeyError(f"{path} is not pinned for {self.name} {self.version}")


@dataclass(frozen=True)
class ProvenanceEntry:
    """The origin of one shipped data file.

    Parameters
    ----------
    data_file : str
        Name of the file in ``catalogs/data``.
    description : str
        What it holds, in one sentence.
    sources : tuple of (SourcePackage, str)
        Package and path of every file that it was derived from; empty for a text written by us.
    derivation : str
        How it was derived.
    licence : str
        Terms of the *shipped* file.
    vintage : str
        Date or epoch of the content.
    notes : tuple of str
        Further facts (coverage, caveats).
    """

    data_file: str
    description: str
    sources: tuple[tuple[SourcePackage, str], ...]
    derivation: str
    licence: str
    vintage: str
    notes: tuple[str, ...] = ()

    def as_dict(self, data_sha256: str) -> dict[str, object]:
        """Return the JSON form, with the digest of the shipped file."""
        return {
            "data_file": self.data_file,
            "sha256": data_sha256,
            "description": self.description,
            "derivation": self.derivation,
            "licence": self.licence,
            "vintage": self.vintage,
            "notes": list(self.notes),
            "sources": [
                {
                    "package": package.name,
                    "version": package.version,
                    "ecosystem": package.ecosystem,
                    "archive": package.archive,
                    "archive_sha256": package.sha256,
                    "package_licence": package.licence,
                    "file": path,
                    "sha256": package.file(path).sha256,
                    "licence": package.file(path).licence,
                    "citation": package.file(path).citation,
                    "vintage": package.file(path).vintage,
                }
                for package, path in self.sources
            ],
        }


def sha256_of(data: bytes) -> str:
    """Return the sha256 of `data` in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


@dataclass
class SourceStore:
    """Verified access to pinned archives in a folder, fetching the missing ones by exact name and version.

    Parameters
    ----------
    folder : Path
        Where the archives are or will be put.
    """

    folder: Path
    _archives: dict[str, bytes] = field(default_factory=dict, repr=False)

    def obtain(self, packages: Iterable[SourcePackage]) -> None:
        """Make sure that every archive is in the folder and has the pinned digest.

        Raises
        ------
        InputError
            If an archive cannot be fetched or its digest differs.
        """
        for package in packages:
            self._archive(package)

    def read(self, package: SourcePackage, path: str) -> bytes:
        """Return the bytes of one pinned file.

        Raises
        ------
        InputError
            If the archive's or the file's digest differs from the manifest.
        KeyError
            If the file is not pinned.
        """
        pinned = package.file(path)
        raw = self._archive(package)
        if package.archive.endswith((".whl", ".zip")):
            with zipfile.ZipFile(io.BytesIO(raw)) as archive:
                data = archive.read(path)
        else:
            with tarfile.open(fileobj=io.BytesIO(raw), mode="r:*") as archive:
                member = archive.extractfile(path)
                if member is None:
                    raise InputError("source file", path, allowed=f"a regular file in {package.archive}")
                data = member.read()
        _check(f"sha256 of {path} in {package.archive}", sha256_of(data), pinned.sha256)
        return data

    def _archive(self, package: SourcePackage) -> bytes:
        if package.archive not in self._archives:
            target = self.folder / package.archive
            if not target.is_file():
                _fetch(package, self.folder)
            if not target.is_file():
                raise InputError("archive", package.archive, hint=f"the client did not deliver it to {self.folder}")
            raw = target.read_bytes()
            _check(f"sha256 of {package.archive}", sha256_of(raw), package.sha256)
            self._archives[package.archive] = raw
        return self._archives[package.archive]


def _check(what: str, found: str, pinned: str) -> None:
    if found != pinned:
        raise InputError(what, found, allowed=pinned, hint="the archive is not the one that was verified")


def _fetch(package: SourcePackage, folder: Path) -> None:
    """Fetch one archive by name and exact version with the ecosystem's own client."""
    if package.ecosystem == "pypi":
        kind = "--only-binary=:all:" if package.archive.endswith(".whl") else "--no-binary=:all:"
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", kind]
        command += ["--dest", str(folder), f"{package.name}=={package.version}"]
    elif package.ecosystem == "npm":
        command = ["npm", "pack", "--silent", "--pack-destination", str(folder), f"{package.name}@{package.version}"]
    else:
        raise InputError("ecosystem", package.ecosystem, allowed="pypi, npm")
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise InputError("package client", command[0], hint="not installed") from error
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise InputError("archive", package.archive, hint=f"fetch failed: {lines[-1] if lines else 'no message'}")
