from simulator.products.check import PROGRAMME_FILE as PROGRAMME_FILE, check_level0 as check_level0
from simulator.products.ephemeris import (
    CircularOrbit as CircularOrbit,
    SequenceTimes as SequenceTimes,
    body_km as body_km,
    earth_radius_deg as earth_radius_deg,
    mjd_of as mjd_of,
    offline_time as offline_time,
    sequence_times as sequence_times,
    times_after as times_after,
)
from simulator.products.naming import (
    OBSID_DIGITS as OBSID_DIGITS,
    ProductName as ProductName,
    checked_obsid as checked_obsid,
    product_name as product_name,
)
from simulator.products.reading import Finding as Finding
from simulator.products.sequence import (
    FrameSequence as FrameSequence,
    PartOfVisit as PartOfVisit,
    Truth as Truth,
    VisitPart as VisitPart,
    orbit_s as orbit_s,
    visit_parts as visit_parts,
)
from simulator.products.write import (
    PARAMS_FILES as PARAMS_FILES,
    refuse_taken as refuse_taken,
    write_level0 as write_level0,
)
