"""Rebuilding the data: verification of archives, provenance of every shipped file, reproducibility."""

import importlib
import io
import json
import os
import tarfile
import zipfile
from pathlib import Path

import pytest

import catalogs
from tools.build_catalogue.build import PROVENANCE_NAME, build_all, builder_names, compare, main
from tools.build_catalogue.sources import ProvenanceEntry, SourceFile, SourcePackage, SourceStore, sha256_of

DATA = Path(catalogs.__file__).parent / "data"
CONTENT = b"one\ntwo\n"


def archive(kind: str) -> bytes:
    stream = io.BytesIO()
    if kind == "whl":
        with zipfile.ZipFile(stream, "w") as file:
            file.writestr("pack/table.txt", CONTENT)
    else:
        with tarfile.open(fileobj=stream, mode="w:gz") as file:
            info = tarfile.TarInfo("pack/table.txt")
            info.size = len(CONTENT)
            file.addfile(info, io.BytesIO(CONTENT))
    return stream.getvalue()


def package(
    kind: str, raw: bytes, *, archive_sha: str = "", file_sha: str = "", ecosystem: str = "pypi"
) -> SourcePackage:
    item = SourceFile("pack/table.txt", file_sha or sha256_of(CONTENT), "public", "nobody", "today")
    return SourcePackage("pack", "1.0", ecosystem, f"pack-1.0.{kind}", archive_sha or sha256_of(raw), "MIT", (item,))


@pytest.mark.parametrize("kind", ["whl", "tgz"])
def test_reads_verified_bytes(tmp_path: Path, kind: str) -> None:
    raw = archive(kind)
    (tmp_path / f"pack-1.0.{kind}").write_bytes(raw)
    store = SourceStore(tmp_path)
    store.obtain([package(kind, raw)])
    assert store.read(package(kind, raw), "pack/table.txt") == CONTENT
    with pytest.raises(KeyError):
        store.read(package(kind, raw), "pack/other.txt")


@pytest.mark.parametrize("change", [{"archive_sha": "0" * 64}, {"file_sha": "0" * 64}])
def test_refuses_other_bytes(refused, tmp_path: Path, change: dict[str, str]) -> None:
    raw = archive("whl")
    (tmp_path / "pack-1.0.whl").write_bytes(raw)
    refused("sha256", SourceStore(tmp_path).read, package("whl", raw, **change), "pack/table.txt")


def test_refuses_an_unknown_ecosystem(refused, tmp_path: Path) -> None:
    raw = archive("whl")
    refused("ecosystem", SourceStore(tmp_path).obtain, [package("whl", raw, ecosystem="elsewhere")])


def test_refuses_unknown_builders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--archives", str(tmp_path), "--out", str(tmp_path / "out"), "--only", "nonsense"]) == 2
    assert "nonsense" in capsys.readouterr().err


def test_compare_names_what_differs(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
        (folder / "same").write_bytes(b"a")
    (one / "changed").write_bytes(b"a")
    (two / "changed").write_bytes(b"b")
    (one / "gone").write_bytes(b"a")
    assert compare(one, two, ["same", "changed", "gone"]) == ["changed: differs", "gone: missing"]


def test_provenance_entry_carries_the_citation() -> None:
    pack = package("whl", archive("whl"))
    entry = ProvenanceEntry("table.csv", "a table", ((pack, "pack/table.txt"),), "copied", "public", "today")
    record = entry.as_dict("f" * 64)
    assert record["sha256"] == "f" * 64
    assert record["sources"][0]["citation"] == "nobody"  # type: ignore[index]


def records() -> list[dict[str, object]]:
    return json.loads((DATA / PROVENANCE_NAME).read_text(encoding="utf-8"))["files"]


def test_every_data_file_has_provenance_and_its_digest() -> None:
    listed = {str(record["data_file"]): record for record in records()}
    present = {path.name for path in DATA.iterdir() if path.is_file()} - {PROVENANCE_NAME}
    built = {name for name in present if name in listed}
    assert {"stars.csv", "aliases.csv", "known_stars.csv", "stars_counts.csv", "STARS_LICENCE.md"} <= built
    assert set(listed) <= present
    for name, record in listed.items():
        assert sha256_of((DATA / name).read_bytes()) == record["sha256"], name
        assert record["licence"]
        assert record["vintage"]
        assert record["builder"] in builder_names()


def test_star_licence_stands_apart() -> None:
    text = (DATA / "STARS_LICENCE.md").read_text(encoding="utf-8")
    for words in ("Open Database License", "SIMBAD", "CDS, Strasbourg", "Hipparcos", "ExoCat-1", "share alike"):
        assert words in text
    stars = next(record for record in records() if record["data_file"] == "stars.csv")
    assert "ODbL" in str(stars["licence"])
    assert any("HIP" in note and "proper name" in note for note in stars["notes"])  # type: ignore[attr-defined]


def test_every_builder_names_its_sources() -> None:
    listed = {record["builder"] for record in records()}
    assert listed == set(builder_names())
    for name in builder_names():
        builder = importlib.import_module(f"tools.build_catalogue.builders.{name}")
        assert callable(builder.build)
        assert all(isinstance(source, SourcePackage) for source in builder.SOURCES)
        assert len(builder.SOURCES) > 0


@pytest.mark.skipif("CPIC_ARCHIVES" not in os.environ, reason="CPIC_ARCHIVES names no folder of pinned archives")
def test_rebuild_is_byte_identical(tmp_path: Path) -> None:
    written = build_all(Path(os.environ["CPIC_ARCHIVES"]), tmp_path)
    assert compare(tmp_path, DATA, written) == []
