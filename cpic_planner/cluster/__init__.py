"""Tasks on Dask clusters, local or given, that lose processes."""
