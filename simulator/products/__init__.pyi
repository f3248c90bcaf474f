from simulator.products.check import check_level0 as check_level0
from simulator.products.ephemeris import (
    CircularOrbit as CircularOrbit,
    body_km as body_km,
    earth_radius_deg as earth_radius_deg,
    mjd_of as mjd_of,
    offline_time as offline_time,
    sequence_times as sequence_times,
)
from simulator.products.naming import (
    OBSID_DIGITS as OBSID_DIGITS,
    ProductName as ProductName,
    checked_obsid as checked_obsid,
    product_name as product_name,
)
from simulator.products.reading import Finding as Finding
from simulator.products.sequence import FrameSequence as FrameSequence, Truth as Truth
from simulator.products.write import (
    PARAMS_FILES as PARAMS_FILES,
    refuse_taken as refuse_taken,
    write_level0 as write_level0,
)
