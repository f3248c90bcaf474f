"""Modules stay few, short and formatted; who may import whom is in ``pyproject.toml`` (``make lint``)."""

import pkgutil
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# 330 held the house before it knew orbits of binaries, limits of velocities and the archive of planets, 350 before
# programmes of visits: their modes, motion, filters and exact light, 355 before images of single stars and of schedules
# stood apart from the main job (`confirm.stars`), 356 before rankings were compared, 357 before ensembles of
# instruments: their laws, the states of the mirror, rankings under them, what they say, and the page of priorities, 362
# before orbits: what positions say of them, and those of the planets that surveys find, 364 before
# schedules chose among plans of stars (`survey.plans`, `survey.bounds`), 367 before plans under doubt,
# 373 before false alarms stood apart from detections and histories of stars from surveys, 374 before planets were asked
# for by name (`api.named`), tables had other forms (`report.files`), instruments were shown on the command line, checks
# of answers in images stood apart from the answers (`report.console_fidelity`), and planets in the dark zone apart from
# what counts them (`ranking.in_zone`), 381 before the calculator was served to browsers: the room `web`, its command,
# and the answer about one star, which page and command share (`api.one_star`), 391 before chances of visits stood apart
# from their law (`etc.chances`), and visits for orbits (`survey.orbit_visits`) and what was published of them
# (`planets.published_orbits`) were counted, 392 before pages of stars, of two instruments and of files that are sent
# (`web.star`, `web.compare`, `web.sent`, `web.blocks`, `report.console_both`), 397 before special functions were loaded
# alone and the light of a star kept (`cpic_core.special_functions`, `etc.star_light`), 399 before the server had jobs:
# their queue, process and pages, runs of a folder, commands and their cost, connections with limits of time, an OpenAPI
# document, and stars that are selected from a kept ranking (`ranking.selection`), 408 before the decision of a plan and
# its pages of stars (`report.decision`, `report.plan_stars`), 410 before results of pages (`results.shown`), 411 before
# times from rates that others worked out (`etc.from_rates`) and values of figures (`report.plotted`), 413 before the
# disk cache stood apart from whole files (`cpic_core.cache`), the parameters of products were checked
# (`simulator.products.check_params`), and fingerprints said what made a number (`cpic_core.provenance`), which workers,
# runs and checks compare (`jobs.handshake`, `jobs.record`, `jobs.chain`), 419 before contrast curves and operating
# characteristics were commands: question, results, programme and images, words, figures and pages of them (`searched`),
# their jobs (`confirm.curve`, `confirm.roc`), what frames promise anywhere in the hole (`etc.prospects`), and
# planets to be measured, which stand apart from their measurement (`validation.templates`),
# 431 before coronagraphs came as tables: the file, maps, figures, writing one, a clear pupil, zones of squares and of
# rings, the optics as configuration, and stamps apart from figures (`config.coronagraph_table`, `config.optics`,
# `imaging.table_metrics`, `imaging.zones`), 439 before words were checked (`tools.words`)
# and what was validated became a table (`tools.site.validation`).
MOST_MODULES, MOST_LINES, MOST_SKIPS = 441, 400, 20


def sources():
    return {
        str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
        for floor in ("cpic_core", "catalogs", "simulator", "cpic_planner")
        for path in (ROOT / floor).rglob("*.py")
    }


def test_one_concept_a_module():
    found = sources()
    large = {name: lines for name, text in found.items() if (lines := len(text.splitlines())) > MOST_LINES}
    assert large == {}
    assert 100 < len(found) <= MOST_MODULES


def test_the_formatter_formats():
    assert sum(text.count("# fmt: skip") for text in sources().values()) <= MOST_SKIPS


def test_the_page_on_architecture_names_what_exists():
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`((?:cpic_core|catalogs|simulator|cpic_planner)(?:[./]\w+)+(?:\.py)?)/?`", page))
    assert len(names) > 15
    for name in names:
        if "/" in name:
            assert (ROOT / name).exists(), name
        else:
            pkgutil.resolve_name(name)
    assert (ROOT / "docs" / "architecture.svg").exists()
    assert len(page.splitlines()) <= 70
