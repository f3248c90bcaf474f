"""What populations, orbits and tables of targets refuse, each in one line."""

from catalogs import orbit_places
from cpic_planner.planets import draw_population, load_population
from cpic_planner.planets.masses import least_mass, radius_from_mass
from cpic_planner.planets.population import read_law
from cpic_planner.queries import read_exclusions
from cpic_planner.targets import load_targets

READERS = {
    "population": load_population,
    "n_planets": lambda n: draw_population(load_population(), n, 1),
    "law": read_law,
    "orbit": lambda elements: orbit_places(*elements),
    "mass": lambda mass_mjup: radius_from_mass([1.0, mass_mjup]),
    "radius": lambda radius_rjup: least_mass([1.0, radius_rjup]),
    "exclusions": read_exclusions,
    "catalog": load_targets,
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
