import subprocess
import sys


def test_importing_the_package_and_the_terminal_tables_is_light():
    code = (
        "import sys\nimport cpic_planner.report, cpic_planner.report.console, cpic_planner.report.tables, "
        "cpic_planner.report.figures\n"
        "import cpic_planner.report.html\n"
        "heavy = {'pandas', 'synphot', 'hcipy', 'matplotlib', 'photutils', 'sep', 'astroquery', 'scipy.stats', "
        "'numba', 'dask', 'astropy'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
