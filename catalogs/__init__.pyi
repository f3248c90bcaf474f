from catalogs.bands import (
    Band as Band,
    band_from_file as band_from_file,
    band_provenance as band_provenance,
    load_bands as load_bands,
)
from catalogs.binaries import (
    POSITION_ERROR_ARCSEC as POSITION_ERROR_ARCSEC,
    BinaryOrbit as BinaryOrbit,
    StabilityLimit as StabilityLimit,
    binary_orbits as binary_orbits,
    stability_limit as stability_limit,
)
from catalogs.catalogue import (
    NAMED_TABLES as NAMED_TABLES,
    PLANET_CREDITS as PLANET_CREDITS,
    Catalogue as Catalogue,
    catalogue_info as catalogue_info,
    catalogue_of_star as catalogue_of_star,
    checked_table_name as checked_table_name,
    data_credits as data_credits,
    open_catalogue as open_catalogue,
    snapshot_vintage as snapshot_vintage,
)
from catalogs.coordinates import (
    position_angle as position_angle,
    separation_arcsec as separation_arcsec,
    tangent_offset as tangent_offset,
)
from catalogs.curves import length_nm as length_nm, read_curve as read_curve
from catalogs.exoplanet_archive import PLANETS_QUERY as PLANETS_QUERY, archive_url as archive_url
from catalogs.known_planet_table import KnownPlanetTable as KnownPlanetTable, star_key as star_key
from catalogs.known_planets import load_known_planets as load_known_planets, split_source as split_source
from catalogs.names import StarMatch as StarMatch, resolve_star as resolve_star
from catalogs.nomenclature import CONSTELLATIONS as CONSTELLATIONS, GREEK as GREEK
from catalogs.orbits import (
    ECCENTRICITY_MAX as ECCENTRICITY_MAX,
    ORBIT as ORBIT,
    OrbitPlaces as OrbitPlaces,
    eccentric_anomaly as eccentric_anomaly,
    orbit_places as orbit_places,
)
from catalogs.own_tables import (
    OwnTables as OwnTables,
    Taken as Taken,
    possible_columns as possible_columns,
    tables_read as tables_read,
    taken_for as taken_for,
)
from catalogs.planet_refresh import (
    RefreshedPlanets as RefreshedPlanets,
    parse_planets as parse_planets,
    planets_ecsv as planets_ecsv,
    refresh_planets as refresh_planets,
)
from catalogs.refresh import (
    Refreshed as Refreshed,
    ecsv_text as ecsv_text,
    parse_refreshed as parse_refreshed,
    refresh_stars as refresh_stars,
)
from catalogs.refreshed_tables import (
    StoredTable as StoredTable,
    data_dir as data_dir,
    file_name as file_name,
    set_aside as set_aside,
    stored_tables as stored_tables,
)
from catalogs.simbad import (
    Cuts as Cuts,
    queries as queries,
    service_url as service_url,
)
from catalogs.spectra import (
    Albedo as Albedo,
    SpectralLibrary as SpectralLibrary,
    Spectrum as Spectrum,
    load_albedo as load_albedo,
    load_johnson_v as load_johnson_v,
    load_pickles as load_pickles,
    load_reference_spectrum as load_reference_spectrum,
    load_stellar_grid as load_stellar_grid,
    load_zodi_table as load_zodi_table,
)
from catalogs.spectral_types import parse_spectral_type as parse_spectral_type, stellar_parameters as stellar_parameters
from catalogs.star_columns import ADDED_FLAGS as ADDED_FLAGS, QUANTITIES as QUANTITIES
from catalogs.star_places import POSITION_ERROR as POSITION_ERROR, stars_at as stars_at
from catalogs.stars import StarTable as StarTable, load_stars as load_stars
from catalogs.stellar_grid import (
    HC_ERG_ANGSTROM as HC_ERG_ANGSTROM,
    GridFlags as GridFlags,
    StellarGrid as StellarGrid,
    bracket as bracket,
)
from catalogs.stellar_physics import (
    luminosity_from_v as luminosity_from_v,
    radius_from_luminosity as radius_from_luminosity,
)
from catalogs.table_cells import (
    CONVENTIONS as CONVENTIONS,
    Column as Column,
    Columns as Columns,
    LeftOut as LeftOut,
    Rows as Rows,
    read_rows as read_rows,
)
from catalogs.table_files import (
    RawColumn as RawColumn,
    RawTable as RawTable,
    Reject as Reject,
    TableBytes as TableBytes,
    astropy_table as astropy_table,
    column_of as column_of,
    parse_table as parse_table,
    read_bytes as read_bytes,
)
from catalogs.tap_client import RefreshError as RefreshError, TapService as TapService
from catalogs.velocity_limits import (
    VELOCITY_AXES_AU as VELOCITY_AXES_AU,
    VelocityLimit as VelocityLimit,
    amplitude_m_s as amplitude_m_s,
    velocity_limit as velocity_limit,
)
from cpic_core.errors import InputError as InputError
