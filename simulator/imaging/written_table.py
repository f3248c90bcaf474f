"""The coronagraph of an instrument written as a table: what `coronagraph.table` reads."""

from pathlib import Path

import numpy as np

from cpic_core import FloatArray, InputError, as_path, check_writable, numeric_context, visible, write_named
from simulator.config import InstrumentLike, load_instrument
from simulator.config.instrument import Instrument
from simulator.imaging.annuli import light_around
from simulator.imaging.store import psf_metrics

N_ROWS = 240
ANNULUS_LAMBDA_D = 1.5
"""Half width of the annulus whose light the table has: that of reductions by default."""


@numeric_context()
def write_coronagraph_table(instrument: InstrumentLike, band: str, path: str | Path) -> Path:
    """Write what the coronagraph of an instrument does in one band, by separation on a diagonal of its zone.

    An instrument that has the file as its ``coronagraph.table`` gives the same answers about single stars, with
    ``zone: quadrants`` where its own is of quadrants, and the drift of the wavefront does there what it does here.
    Between the diagonals the coronagraph may differ, and the light of companions is then that of a clear pupil.

    Parameters
    ----------
    instrument : Instrument, mapping, str or Path
        Preset name, YAML file, or mapping.
    band : str
        Name of a band of the instrument.
    path : str or Path
        CSV file to write, a name that ends in ``.csv``.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        For an unknown instrument or band, another name, or a place that cannot be written.
    OSError
        If the disk is full or broken.
    """
    place = as_path("path", path)
    if place.suffix != ".csv":
        raise InputError("path", path, allowed="a name that ends in .csv")
    check_writable(place, key="path")
    chosen = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    separation, columns = _columns(chosen, band)
    about = (
        f"Coronagraph of the instrument {chosen.name} ({chosen.content_hash}) in {band}, on a diagonal of its zone.",
        "Written by write_coronagraph_table of cpic-planner; light is over that on the clear pupil.",
    )
    names = ["separation_arcsec", *columns]
    rows = np.column_stack([separation, *(np.broadcast_to(values, separation.shape) for values in columns.values())])
    lines = [*(f"# {line}" for line in about), ",".join(names)]
    lines += [",".join(f"{value:.7g}" for value in row) for row in rows.tolist()]
    return write_named(place, "\n".join(map(visible, lines)) + "\n", key="path")


def _columns(instrument: Instrument, band: str) -> tuple[FloatArray, dict[str, FloatArray | float]]:
    metrics = psf_metrics(instrument, band)
    zone = metrics.zone
    # Both ends of the zone, or of the table, and the rings whose residuals were measured are rows of their own.
    corners = max(zone.inner_corner_arcsec, 1e-3), zone.outer_corner_arcsec
    ends = zone.usable_range_arcsec(metrics.aperture_radius_arcsec) if instrument.coronagraph.is_ring else corners
    grid = np.linspace(*ends, N_ROWS)
    rings = metrics.floor_separation_arcsec
    separation = np.unique(np.concatenate([grid, rings[(rings > grid[0]) & (rings < grid[-1])]]).round(7))
    x, y = (sign * separation / np.sqrt(2.0) for sign in zone.diagonal)
    core = metrics.core_throughput(x, y)
    lit = core > 1e-6 * core.max()
    separation, x, y, core = separation[lit], x[lit], y[lit], core[lit]
    of_errors = {"psd_slope": instrument.drift.psd_slope, "wavelength_nm": instrument.band(band).center_nm}
    around = light_around(metrics, ANNULUS_LAMBDA_D, x, y, **of_errors)
    linear, square = (np.exp(np.interp(separation, rings, logs)) for logs in metrics.floor_logs())
    beyond = np.maximum(separation / rings[-1], 1.0)
    stable = metrics.stability(separation)
    residual: dict[str, FloatArray | float] = (
        {"contrast_stability": np.sqrt(stable[0]) / core}
        if stable is not None
        else {
            "speckle_variance_per_nm2": linear * beyond ** _power(rings, metrics.floor_logs()[0]),
            "speckle_variance_per_nm4": square * beyond ** _power(rings, metrics.floor_logs()[1]),
        }
    )
    return separation, {
        "core_throughput": core,
        "raw_contrast": metrics.halo_aperture(x, y) / core,
        "noise_contrast": around.star / core,
        "error_light_per_nm2": around.errors,
        "planet_left": around.planet_left,
        **residual,
        "occulter_transmission": np.maximum(metrics.dust_transmission(x, y, core), core),
        "sky_transmission": np.maximum(metrics.apodizer_energy * metrics.sky_share(x, y), core),
        "core_area_arcsec2": metrics.core_pixels(x, y) * metrics.pixel_scale_arcsec**2,
        "source_peak_pixel": metrics.peak_off_axis,
        "star_peak_zone": metrics.peak_on_axis_hole,
        "star_peak_columns": metrics.peak_on_axis_columns,
        "star_peak_frame": metrics.peak_on_axis_frame,
        "star_register_tail": metrics.register_tail,
        "star_columns": metrics.column_aperture(x),
        "noise_fraction": metrics.noise_fraction,
        "source_noise_fraction": metrics.source_noise_fraction,
        "filter_gain": np.interp(separation, rings, metrics.filter_gain),
        **{
            f"filter_linear_{number}": np.interp(separation, rings, fifth)
            for number, fifth in enumerate(metrics.filter_linear.T, 1)
        },
        **{name: getattr(metrics, name) for name in _FILTER},
    }


_FILTER = "filter_square", "filter_tails", "filter_positions", "filter_roughness"


def _power(rings: FloatArray, logs: FloatArray) -> float:
    """Return the power of the separation by which a residual falls beyond the last ring; see `speckles`."""
    return 0.0 if len(rings) < 2 else min(float((logs[-1] - logs[-2]) / np.log(rings[-1] / rings[-2])), 0.0)
