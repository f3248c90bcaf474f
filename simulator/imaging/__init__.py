"""Imaging: apodizer, point-spread functions, focal-plane mask, wavefront drift and their figures."""
