"""Observational effects: cosmic rays, light of the sky, earthshine and stray light."""

from simulator.effects.cosmic_ray_rate import cosmic_ray_rate
from simulator.effects.cosmic_rays import CosmicRays, draw_cosmic_rays
from simulator.effects.sky import SkyLevel, sky_rate_e_s_arcsec2
from simulator.effects.stray_light import effect_files, stray_light_map

__all__ = [
    "CosmicRays",
    "SkyLevel",
    "cosmic_ray_rate",
    "draw_cosmic_rays",
    "effect_files",
    "sky_rate_e_s_arcsec2",
    "stray_light_map",
]
