from cpic_planner.simulation.run import (
    simulate as simulate,
    simulation_estimate as simulation_estimate,
    simulation_from as simulation_from,
)
