from cpic_planner.planets.allowed import StarLimits as StarLimits, excluded_by_rv as excluded_by_rv
from cpic_planner.planets.laws import Law as Law, chosen_entry as chosen_entry, read_law as read_law
from cpic_planner.planets.mass_radius import least_mass as least_mass
from cpic_planner.planets.motion import (
    ORBIT_DUTY as ORBIT_DUTY,
    masses_of_gravity_msun as masses_of_gravity_msun,
    smeared as smeared,
    span_days as span_days,
    star_masses_msun as star_masses_msun,
)
from cpic_planner.planets.orbit_search import OrbitSearch as OrbitSearch
from cpic_planner.planets.population import (
    OrbitingPlanets as OrbitingPlanets,
    Planets as Planets,
    PopulationChoice as PopulationChoice,
    draw_population as draw_population,
)
from cpic_planner.planets.population_config import (
    PopulationConfig as PopulationConfig,
    load_population as load_population,
)
from cpic_planner.planets.published_orbits import (
    FLOOR_MAS as FLOOR_MAS,
    STAR_MASS_ERROR as STAR_MASS_ERROR,
    Ephemeris as Ephemeris,
    OrbitInformation as OrbitInformation,
    OrbitQuality as OrbitQuality,
    PublishedOrbit as PublishedOrbit,
    astrometric_error_arcsec as astrometric_error_arcsec,
    draw_known as draw_known,
    ephemeris as ephemeris,
    known_uniforms as known_uniforms,
    orbit_information as orbit_information,
    orbit_quality as orbit_quality,
    places_at as places_at,
    planets_of as planets_of,
    published_orbit as published_orbit,
    quantiles as quantiles,
)
