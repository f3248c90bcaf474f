"""What writes that fail, are refused or are killed leave behind."""

import pytest

from simulator.products import check_level0, write_level0


class Broken(RuntimeError):
    pass


def below(root):
    """Everything below a folder, hidden and empty ones too."""
    return sorted(str(path.relative_to(root)) for path in root.rglob("*")) if root.exists() else None


class Failing:
    """A sequence that fails after its first frame."""

    def __new__(cls, base):
        class Fails(type(base)):
            def iter_full_frames(self):
                yield self.frame(0)
                raise Broken

        return Fails()


def test_a_write_that_fails_leaves_no_folder(sequence, tmp_path):
    with pytest.raises(Broken):
        write_level0(Failing(sequence()), tmp_path / "new" / "tree")
    assert below(tmp_path) == []
    write_level0(sequence(start_utc="2028-05-01"), tmp_path / "tree")
    before = below(tmp_path)
    with pytest.raises(Broken):
        write_level0(Failing(sequence()), tmp_path / "tree")
    assert below(tmp_path) == before
    (tmp_path / "tree" / "SCI" / "61834").mkdir()  # one that somebody else has made stays
    before = below(tmp_path)
    with pytest.raises(Broken):
        write_level0(Failing(sequence()), tmp_path / "tree")
    assert below(tmp_path) == before


def test_parameters_that_cannot_be_written_leave_nothing(sequence, tmp_path, monkeypatch):
    from simulator.products import write

    real, calls = write.write_text, []

    def full_disk(path, text):
        calls.append(path)
        if len(calls) == 3:
            raise OSError("no space left")
        return real(path, text)

    monkeypatch.setattr(write, "write_text", full_disk)
    with pytest.raises(OSError, match="no space"):
        write_level0(sequence(), tmp_path)
    assert below(tmp_path) == []


def test_what_a_killed_run_left_goes_with_the_next_one(sequence, tmp_path):
    path = write_level0(sequence(), tmp_path)
    truth = next((tmp_path / "Truth").rglob("*.fits"))
    left = [place.parent / f".{place.name}.abc123.part" for place in (path, truth)]
    other = path.parent / f".{path.name.replace('_V01', '_V02')}.abc123.part"
    for place in (*left, other):
        place.write_bytes(b"half")
    assert len([f for f in check_level0(tmp_path) if "interrupted" in f.message]) == 3
    write_level0(sequence(), tmp_path, overwrite=True)
    assert not any(place.exists() for place in left)
    assert other.exists()
    assert [f.path for f in check_level0(tmp_path)] == [other]


def test_a_run_that_is_killed_leaves_a_part_that_a_living_one_keeps(refused, sequence, tmp_path):
    """Another writer of the same file, still at work, does not lose its own."""
    kept = []

    class Slow(type(sequence())):
        def iter_full_frames(self):
            yield from super().iter_full_frames()
            mine = set(tmp_path.rglob("*.part"))
            write_level0(sequence(), tmp_path, obsid=40000000001)
            kept.append(mine and mine <= set(tmp_path.rglob("*.part")))

    refused("file", write_level0, Slow(), tmp_path, obsid=40000000001)
    assert kept == [True]
    # The faster one's truth and parameters are its own.
    assert check_level0(tmp_path) == []


def test_a_sequence_that_ends_too_late_is_refused(refused, sequence, tmp_path):
    refused("end of the last frame = 2101-01-01", write_level0, sequence(start_utc="2100-12-31T23:59:50"), tmp_path)
    assert below(tmp_path) == []
