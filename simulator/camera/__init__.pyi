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
    stack_electrons as stack_electrons,
    stackable as stackable,
)
from simulator.camera.noise import FrameNoise as FrameNoise, aperture_loss_per_s as aperture_loss_per_s
from simulator.detectors.effect import Effect as Effect, Exposure as Exposure
from simulator.detectors.gain import (
    em_voltage_of as em_voltage_of,
    excess_noise_factor2 as excess_noise_factor2,
    multiply as multiply,
    stage_probability as stage_probability,
)
from simulator.detectors.variance import aperture_noise_pixels as aperture_noise_pixels
from simulator.signal.saturation import pixel_saturated as pixel_saturated
