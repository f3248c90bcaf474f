from simulator.reduction.cosmic_rays import (
    PixelLaw as PixelLaw,
    Rejection as Rejection,
    grown as grown,
    reject_cosmic_rays as reject_cosmic_rays,
)
from simulator.reduction.level1 import (
    Level1 as Level1,
    Level1Frame as Level1Frame,
    error_file as error_file,
    level1_name as level1_name,
    read_level1 as read_level1,
    write_level1 as write_level1,
)
from simulator.reduction.steps import Calibration as Calibration, Master as Master, Pixels as Pixels
