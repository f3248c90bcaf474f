"""Plans, confirmations and simulated products, by star names and plain numbers."""

from __future__ import annotations

from cpic_planner.api.inputs import model_of, stars_named
from cpic_planner.api.keywords import takes
from cpic_planner.models import ConfirmedTarget, ConfirmResult, PlanResult, SimulationResult
from cpic_planner.queries.confirm import ConfirmQuestion
from cpic_planner.queries.images import StarImagesQuestion
from cpic_planner.queries.plan import PlanQuestion
from cpic_planner.queries.simulate import SimulateQuestion


@takes(PlanQuestion, first=("out",), needs=("out",))
def make_plan(question: PlanQuestion) -> PlanResult:
    """Run the main job and write its products into ``out``; an interrupted run continues there.

    Returns
    -------
    PlanResult

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.plan import make_plan as run

    return run(
        question,
        question.out,
        catalog=question.catalog,
        workers=question.workers,
        scheduler=question.scheduler,
        force=question.force,
    ).result


@takes(StarImagesQuestion, first=("target",), without=("force", "scheduler"))
def confirm_targets(question: StarImagesQuestion) -> list[ConfirmedTarget]:
    """Simulate and measure the named stars, each with its reference planet at the best separation.

    Returns
    -------
    list of ConfirmedTarget
        In the given order.

    Raises
    ------
    InputError
        For an unknown star or band, or a value out of range.
    """
    from cpic_planner.confirmed import confirm_stars

    return confirm_stars(
        model_of(question),
        stars_named(question.target, question.companions, question.catalog),
        time_s=question.time_s,
        planet=question.planet,
        workers=question.workers,
        **question.image_settings,
    )


@takes(ConfirmQuestion, first=("scene",))
def confirm_scene(question: ConfirmQuestion) -> ConfirmResult:
    """Observe one scene in simulated images and measure it blind, beside what the ETC expects, as ``cpic confirm``.

    Returns
    -------
    ConfirmResult

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.scene_confirmation import confirm_scene as run

    return run(
        question, question.out, workers=question.workers, scheduler=question.scheduler, force=question.force
    ).result


@takes(SimulateQuestion, first=("what", "out"))
def simulate_products(question: SimulateQuestion) -> SimulationResult:
    """Make Level-0 products with truth, as ``cpic simulate`` does.

    Returns
    -------
    SimulationResult
        ``sequences[i].file`` is the Level-0 file below ``out``.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    from cpic_planner.simulation.inputs import simulation_from
    from cpic_planner.simulation.run import simulate

    simulation, _ = simulation_from(
        question.what, settings=question.settings, changes=question.changes, instrument=question.instrument
    )
    return simulate(
        simulation,
        question.out,
        workers=question.workers,
        scheduler=question.scheduler,
        force=question.force,
        truth=question.truth,
    ).result
