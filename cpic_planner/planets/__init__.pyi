from cpic_planner.planets.allowed import StarLimits as StarLimits, excluded_by_rv as excluded_by_rv
from cpic_planner.planets.masses import (
    least_mass as least_mass,
    masses_of_gravity_msun as masses_of_gravity_msun,
    star_masses_msun as star_masses_msun,
)
from cpic_planner.planets.motion import ORBIT_DUTY as ORBIT_DUTY, OrbitSearch as OrbitSearch, span_days as span_days
from cpic_planner.planets.population import (
    MAX_PLANETS as MAX_PLANETS,
    N_PLANETS as N_PLANETS,
    Law as Law,
    OrbitingPlanets as OrbitingPlanets,
    Planets as Planets,
    PopulationChoice as PopulationChoice,
    PopulationConfig as PopulationConfig,
    chosen_entry as chosen_entry,
    draw_population as draw_population,
    load_population as load_population,
    read_law as read_law,
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
