from cpic_core import overlap_weights as overlap_weights
from simulator.config.map_files import (
    FileMap as FileMap,
    array_number as array_number,
    header_number as header_number,
    read_maps as read_maps,
    real_map as real_map,
)
from simulator.imaging.annuli import (
    APART_RADII as APART_RADII,
    STEP_PIXELS as STEP_PIXELS,
    AnnulusLight as AnnulusLight,
    by_geometry as by_geometry,
    error_halo as error_halo,
    light_around as light_around,
    mean_over as mean_over,
    noise_apertures as noise_apertures,
    quadrant_of as quadrant_of,
)
from simulator.imaging.aperture import aperture_sums as aperture_sums
from simulator.imaging.build import build_imager as build_imager
from simulator.imaging.drift import SharedTerms as SharedTerms, visit_frames as visit_frames, wavefronts as wavefronts
from simulator.imaging.external import ExternalPsf as ExternalPsf
from simulator.imaging.frame import (
    AnyPsf as AnyPsf,
    SceneModel as SceneModel,
    Window as Window,
    forget_starlight as forget_starlight,
    full_star_map as full_star_map,
    off_axis_light as off_axis_light,
    sky_transmission as sky_transmission,
    star_column_light as star_column_light,
    window_of as window_of,
)
from simulator.imaging.imager import FocalGrid as FocalGrid, Imager as Imager
from simulator.imaging.light_expansion import (
    LARGEST_NM as LARGEST_NM,
    RMS_ERROR as RMS_ERROR,
    VisitLight as VisitLight,
    expands as expands,
    visit_light as visit_light,
)
from simulator.imaging.measure import matched_kernel as matched_kernel, visit_responses as visit_responses
from simulator.imaging.metrics import PsfMetrics as PsfMetrics
from simulator.imaging.psf import Psf as Psf, PsfError as PsfError, single_band_psf as single_band_psf
from simulator.imaging.pupil import shipped_file as shipped_file
from simulator.imaging.sampling import centred_axis as centred_axis, pixel_axis as pixel_axis
from simulator.imaging.store import (
    at_contrast as at_contrast,
    mean_contrast as mean_contrast,
    measured_states as measured_states,
    metrics_key as metrics_key,
    psf_metrics as psf_metrics,
    published_bands as published_bands,
)
from simulator.imaging.table_metrics import TableMetrics as TableMetrics, scattered_light as scattered_light
from simulator.imaging.table_psf import TablePsf as TablePsf, psf_of_table as psf_of_table
from simulator.imaging.zones import (
    BandGeometry as BandGeometry,
    HoleMode as HoleMode,
    HoleSide as HoleSide,
    HoleZone as HoleZone,
    RingZone as RingZone,
    Zone as Zone,
    ZoneMode as ZoneMode,
    zone_from as zone_from,
    zone_of as zone_of,
)
