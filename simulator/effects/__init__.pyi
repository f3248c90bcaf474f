from simulator.effects.cosmic_rays import (
    CosmicRays as CosmicRays,
    TemplateSet as TemplateSet,
    cosmic_ray_rate as cosmic_ray_rate,
    draw_cosmic_rays as draw_cosmic_rays,
    generated_projection_um as generated_projection_um,
    read_templates as read_templates,
)
from simulator.effects.sky import (
    SKY_PLACE_UNKNOWN as SKY_PLACE_UNKNOWN,
    SOLAR_AVOIDANCE as SOLAR_AVOIDANCE,
    SkyLevel as SkyLevel,
    ecliptic_deg as ecliptic_deg,
    effect_files as effect_files,
    extra_lights as extra_lights,
    sky_place_unknown as sky_place_unknown,
    sky_rate_e_s_arcsec2 as sky_rate_e_s_arcsec2,
    sky_rates_e_s_arcsec2 as sky_rates_e_s_arcsec2,
    stray_light_map as stray_light_map,
    stray_light_parts as stray_light_parts,
    unit_factor as unit_factor,
)
