from simulator.camera.calibration_set import (
    CalibrationSet as CalibrationSet,
    MaskBit as MaskBit,
    bias_level_adu as bias_level_adu,
    load_calibration_set as load_calibration_set,
    write_calibration_set as write_calibration_set,
)
from simulator.camera.camera import (
    Camera as Camera,
    Frame as Frame,
    InfraredCamera as InfraredCamera,
    VisibleCamera as VisibleCamera,
    camera_keywords as camera_keywords,
    earlier_frames as earlier_frames,
    expected_adu_map as expected_adu_map,
    expose_frame as expose_frame,
    stack_electrons as stack_electrons,
    stackable as stackable,
    to_electrons as to_electrons,
)
from simulator.camera.noise import (
    FrameNoise as FrameNoise,
    aperture_loss_per_s as aperture_loss_per_s,
    pixel_variance_e2 as pixel_variance_e2,
)
from simulator.detectors.effect import Effect as Effect, Exposure as Exposure
from simulator.detectors.gain import (
    em_gain_of as em_gain_of,
    em_voltage_of as em_voltage_of,
    excess_noise_factor2 as excess_noise_factor2,
    gain_variance as gain_variance,
    multiply as multiply,
    stage_probability as stage_probability,
)
from simulator.detectors.variance import aperture_noise_pixels as aperture_noise_pixels
from simulator.signal.saturation import (
    GainCap as GainCap,
    binding_limit as binding_limit,
    gain_cap as gain_cap,
    pixel_saturated as pixel_saturated,
)
