"""Long work in an output folder: one loop for every kind of job, on one machine or on a cluster."""
