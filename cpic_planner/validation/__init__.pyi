from cpic_planner.etc.detection import detection_threshold as detection_threshold, threshold_array as threshold_array
from cpic_planner.validation.albedo_fit import (
    AlbedoFit as AlbedoFit,
    AlbedoModel as AlbedoModel,
    fit_albedo as fit_albedo,
    planet_albedo_model as planet_albedo_model,
)
from cpic_planner.validation.astrometry import Astrometry as Astrometry, fit_position as fit_position
from cpic_planner.validation.confirm import confirm_task as confirm_task, decode_arrays as decode_arrays
from cpic_planner.validation.cubes import (
    Cube as Cube,
    CubeKind as CubeKind,
    calibrated_cube as calibrated_cube,
    cube_files as cube_files,
)
from cpic_planner.validation.frames import (
    CalibratedFrames as CalibratedFrames,
    calibrated_frames as calibrated_frames,
    combine as combine,
    filled as filled,
)
from cpic_planner.validation.injection import (
    INTERVAL as INTERVAL,
    SearchTask as SearchTask,
    azimuth_share as azimuth_share,
    azimuths_inside as azimuths_inside,
    fraction_interval as fraction_interval,
    search_task as search_task,
)
from cpic_planner.validation.level1 import (
    Level1File as Level1File,
    Level1Programme as Level1Programme,
    level1_files as level1_files,
    level1_programmes as level1_programmes,
    realise_files as realise_files,
)
from cpic_planner.validation.measure import (
    Measurement as Measurement,
    PlanetTemplate as PlanetTemplate,
    measure_planets as measure_planets,
    planet_templates as planet_templates,
)
from cpic_planner.validation.photometry import (
    Photometry as Photometry,
    aperture_photometry as aperture_photometry,
    aperture_weights as aperture_weights,
    edge_crossed as edge_crossed,
)
from cpic_planner.validation.rdi import (
    RdiResult as RdiResult,
    ReducedStack as ReducedStack,
    RollResult as RollResult,
    pedestal_e as pedestal_e,
    rdi_subtract as rdi_subtract,
    reduce_stack as reduce_stack,
    roll_photometry as roll_photometry,
    roll_subtract as roll_subtract,
)
from cpic_planner.validation.realise import (
    FrameStatistics as FrameStatistics,
    Realisation as Realisation,
    VisitPair as VisitPair,
    cleaned as cleaned,
    realisations as realisations,
    realise_frames as realise_frames,
    visit_pair as visit_pair,
)
from cpic_planner.validation.registration import (
    Shift as Shift,
    measured_shift as measured_shift,
    moved as moved,
    star_light as star_light,
)
from cpic_planner.validation.search import (
    BlindSearch as BlindSearch,
    Candidate as Candidate,
    SpeckleMaps as SpeckleMaps,
)
from cpic_planner.validation.star_flux import (
    StarFlux as StarFlux,
    observe_off_mask as observe_off_mask,
    star_flux_off_mask as star_flux_off_mask,
)
from cpic_planner.validation.task import (
    TOO_MANY as TOO_MANY,
    ConfirmTask as ConfirmTask,
    Frames as Frames,
    ImageSettings as ImageSettings,
    LibraryPlan as LibraryPlan,
    Modelling as Modelling,
    expected_of as expected_of,
    gap_s as gap_s,
    images_of as images_of,
    library_plan as library_plan,
    modelling_of as modelling_of,
    modelling_record as modelling_record,
    not_observed as not_observed,
    prepare_task as prepare_task,
    star_scene as star_scene,
    target_scene as target_scene,
    task_cost as task_cost,
    task_of as task_of,
)
from cpic_planner.validation.verdict import (
    PREDICTION_ERROR as PREDICTION_ERROR,
    Calibration as Calibration,
    FittedAlbedo as FittedAlbedo,
    albedo_fits as albedo_fits,
    albedo_records as albedo_records,
    calibrate as calibrate,
    contrasts_of as contrasts_of,
    mean_snr as mean_snr,
    position_records as position_records,
    refusals_of as refusals_of,
    significant_at_place as significant_at_place,
    snr_scatter as snr_scatter,
    target_verdict as target_verdict,
)
from simulator.reduction import reject_cosmic_rays as reject_cosmic_rays
