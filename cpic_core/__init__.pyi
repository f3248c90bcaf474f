from cpic_core.cache import (
    cache_dir as cache_dir,
    cache_info as cache_info,
    clear_cache as clear_cache,
    compute_once as compute_once,
)
from cpic_core.discs import disc_overlap as disc_overlap, overlap_weights as overlap_weights
from cpic_core.errors import (
    ClusterError as ClusterError,
    InputError as InputError,
    listed as listed,
    one_line as one_line,
    shortened as shortened,
    visible as visible,
)
from cpic_core.files import (
    NPZ_ERRORS as NPZ_ERRORS,
    LockHeld as LockHeld,
    check_writable as check_writable,
    dump_json as dump_json,
    exclusive_lock as exclusive_lock,
    guarded as guarded,
    npz_in as npz_in,
    open_npz as open_npz,
    parse_json as parse_json,
    read_npz as read_npz,
    unguarded as unguarded,
    utf8 as utf8,
    whole_file as whole_file,
    write_bytes as write_bytes,
    write_named as write_named,
    write_npz as write_npz,
    write_text as write_text,
)
from cpic_core.outcome import Outcome as Outcome, Outcomes as Outcomes, Reason as Reason, Status as Status
from cpic_core.provenance import (
    PROMISES as PROMISES,
    Fingerprint as Fingerprint,
    differing_words as differing_words,
    fingerprint as fingerprint,
    promise_of as promise_of,
)
from cpic_core.quantities import (
    ArrayLike as ArrayLike,
    BoolArray as BoolArray,
    ComplexArray as ComplexArray,
    FloatArray as FloatArray,
    IntArray as IntArray,
    NDArray as NDArray,
    check_finite as check_finite,
    check_flag as check_flag,
    check_number as check_number,
    check_pair as check_pair,
    check_positive as check_positive,
    check_whole as check_whole,
    check_word as check_word,
    checked_array as checked_array,
    checked_scalar as checked_scalar,
    converted as converted,
    element_name as element_name,
    in_unit as in_unit,
    is_quantity as is_quantity,
    number_and_unit as number_and_unit,
    real_array as real_array,
    require as require,
    unit_of as unit_of,
    units_like as units_like,
)
from cpic_core.random_streams import PathPart as PathPart, stream as stream
from cpic_core.registry import Registry as Registry
from cpic_core.runtime import (
    LOGGER as LOGGER,
    THREAD_VARIABLES as THREAD_VARIABLES,
    Advance as Advance,
    announce as announce,
    load_kernels as load_kernels,
    load_quietly as load_quietly,
    numeric_context as numeric_context,
    private_folder as private_folder,
    untold as untold,
)
from cpic_core.special_functions import special as special
from cpic_core.user_files import (
    as_path as as_path,
    at_home as at_home,
    bounded_fits as bounded_fits,
    digest_of as digest_of,
    file_state as file_state,
    files_read as files_read,
    is_file as is_file,
    only_sent_files as only_sent_files,
    open_file as open_file,
    read_file as read_file,
    read_text as read_text,
    refuse_sent as refuse_sent,
    was_sent as was_sent,
)
from cpic_core.yaml_files import (
    Provenance as Provenance,
    by_line as by_line,
    faults_by_line as faults_by_line,
    load_mapping as load_mapping,
    load_yaml as load_yaml,
    parse_yaml as parse_yaml,
    split_sourced as split_sourced,
)
