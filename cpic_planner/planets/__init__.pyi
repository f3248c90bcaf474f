from cpic_planner.planets.known_draws import (
    Ephemeris as Ephemeris,
    draw_known as draw_known,
    ephemeris as ephemeris,
    known_uniforms as known_uniforms,
    places_at as places_at,
    planets_of as planets_of,
    quantiles as quantiles,
)
from cpic_planner.planets.laws import chosen_entry as chosen_entry
from cpic_planner.planets.orbits import OrbitingPlanets as OrbitingPlanets
from cpic_planner.planets.population import (
    Planets as Planets,
    PopulationChoice as PopulationChoice,
    draw_population as draw_population,
)
from cpic_planner.planets.population_config import (
    PopulationConfig as PopulationConfig,
    load_population as load_population,
)
