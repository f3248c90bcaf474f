from simulator.products.check import (
    CUBE_FOLDER as CUBE_FOLDER,
    PROGRAMME_FILE as PROGRAMME_FILE,
    Finding as Finding,
    check_level0 as check_level0,
)
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
from simulator.products.keywords import load_keywords as load_keywords
from simulator.products.sequence import (
    OBSID_DIGITS as OBSID_DIGITS,
    PartOfVisit as PartOfVisit,
    ProductName as ProductName,
    VisitPart as VisitPart,
    checked_obsid as checked_obsid,
    orbit_s as orbit_s,
    product_name as product_name,
    visit_parts as visit_parts,
)
from simulator.products.write import (
    PARAMS_FILES as PARAMS_FILES,
    refuse_taken as refuse_taken,
    write_level0 as write_level0,
)
