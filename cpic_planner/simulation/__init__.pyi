from cpic_planner.simulation.inputs import (
    simulation_estimate as simulation_estimate,
    simulation_from as simulation_from,
)
from cpic_planner.simulation.run import simulate as simulate
