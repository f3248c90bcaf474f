from simulator.reduction.cosmic_rays import (
    PixelLaw as PixelLaw,
    Rejection as Rejection,
    grown as grown,
    reject_cosmic_rays as reject_cosmic_rays,
)
from simulator.reduction.level0 import Level0 as Level0, read_level0 as read_level0
from simulator.reduction.level1 import (
    Level1 as Level1,
    Level1Frame as Level1Frame,
    error_file as error_file,
    fits_units as fits_units,
    level1_name as level1_name,
    named_header as named_header,
    read_level1 as read_level1,
    write_level1 as write_level1,
)
from simulator.reduction.masters import (
    MASTER_KINDS as MASTER_KINDS,
    Masters as Masters,
    Plan as Plan,
    files_under as files_under,
    make_master as make_master,
    map_kind as map_kind,
    plans_for as plans_for,
    read_master as read_master,
    write_master as write_master,
)
from simulator.reduction.sequence import Reduced as Reduced, reduce_sequence as reduce_sequence
from simulator.reduction.steps import Calibration as Calibration, Master as Master, Pixels as Pixels
