from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.report import write_whatif
from cpic_planner.report.whatif import targets_csv


def test_page_and_table_are_written_the_same_every_time(compared, tmp_path):
    result = compared(["one", "two"])
    pages = []
    for name in ("a", "b"):
        with open_run_folder(tmp_path / name, kind="whatif", config_hash="0") as folder:
            write_whatif(folder, result)
        assert (tmp_path / name / "targets.csv").read_text(encoding="utf-8") == targets_csv(result)
        pages.append((tmp_path / name / "report.html").read_bytes())
    assert pages[0] == pages[1]
    assert b'id="figure-curves"' in pages[0]
