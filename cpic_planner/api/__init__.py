"""The public functions of the planner, by star names and plain numbers; `cpic_planner` has them all."""
