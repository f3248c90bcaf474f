from catalogs.archives import (
    RefreshError as RefreshError,
    StoredTable as StoredTable,
    TapService as TapService,
    data_dir as data_dir,
    file_name as file_name,
    parse_refreshed as parse_refreshed,
    set_aside as set_aside,
    stored_tables as stored_tables,
)
from catalogs.bands import (
    Band as Band,
    band_from_file as band_from_file,
    band_provenance as band_provenance,
    load_bands as load_bands,
)
from catalogs.binaries import (
    POSITION_ERROR as POSITION_ERROR,
    POSITION_ERROR_ARCSEC as POSITION_ERROR_ARCSEC,
    BinaryOrbit as BinaryOrbit,
    StabilityLimit as StabilityLimit,
    binary_orbits as binary_orbits,
    stability_limit as stability_limit,
    stars_at as stars_at,
)
from catalogs.catalogue import (
    NAMED_TABLES as NAMED_TABLES,
    PLANET_CREDITS as PLANET_CREDITS,
    Catalogue as Catalogue,
    TableReading as TableReading,
    catalogue_info as catalogue_info,
    catalogue_of_star as catalogue_of_star,
    checked_table_name as checked_table_name,
    data_credits as data_credits,
    open_catalogue as open_catalogue,
    possible_columns as possible_columns,
    snapshot_vintage as snapshot_vintage,
    table_readings as table_readings,
)
from catalogs.coordinates import (
    position_angle as position_angle,
    separation_arcsec as separation_arcsec,
    tangent_offset as tangent_offset,
)
from catalogs.curves import length_nm as length_nm, read_curve as read_curve
from catalogs.exoplanet_archive import (
    PLANETS_QUERY as PLANETS_QUERY,
    RefreshedPlanets as RefreshedPlanets,
    archive_url as archive_url,
    planets_ecsv as planets_ecsv,
    refresh_planets as refresh_planets,
)
from catalogs.known_planets import (
    KnownPlanetTable as KnownPlanetTable,
    load_known_planets as load_known_planets,
    parse_planets as parse_planets,
    split_source as split_source,
    star_key as star_key,
)
from catalogs.names import StarMatch as StarMatch, resolve_star as resolve_star
from catalogs.nomenclature import CONSTELLATIONS as CONSTELLATIONS, GREEK as GREEK
from catalogs.orbits import (
    ECCENTRICITY_MAX as ECCENTRICITY_MAX,
    ORBIT as ORBIT,
    OrbitPlaces as OrbitPlaces,
    eccentric_anomaly as eccentric_anomaly,
    orbit_places as orbit_places,
)
from catalogs.simbad import (
    Cuts as Cuts,
    Refreshed as Refreshed,
    ecsv_text as ecsv_text,
    queries as queries,
    refresh_stars as refresh_stars,
    service_url as service_url,
)
from catalogs.spectra import (
    HC_ERG_ANGSTROM as HC_ERG_ANGSTROM,
    Albedo as Albedo,
    GridFlags as GridFlags,
    SpectralLibrary as SpectralLibrary,
    Spectrum as Spectrum,
    StellarGrid as StellarGrid,
    bracket as bracket,
    load_albedo as load_albedo,
    load_johnson_v as load_johnson_v,
    load_pickles as load_pickles,
    load_reference_spectrum as load_reference_spectrum,
    load_stellar_grid as load_stellar_grid,
    load_zodi_table as load_zodi_table,
)
from catalogs.stars import (
    ADDED_FLAGS as ADDED_FLAGS,
    QUANTITIES as QUANTITIES,
    SHIPPED_FLAGS as SHIPPED_FLAGS,
    StarTable as StarTable,
    load_stars as load_stars,
)
from catalogs.stellar_physics import (
    luminosity_from_v as luminosity_from_v,
    parse_spectral_type as parse_spectral_type,
    radius_from_luminosity as radius_from_luminosity,
    stellar_parameters as stellar_parameters,
)
from catalogs.table_cells import (
    CONVENTIONS as CONVENTIONS,
    Column as Column,
    Columns as Columns,
    Rows as Rows,
    read_rows as read_rows,
)
from catalogs.table_files import (
    LeftOut as LeftOut,
    RawColumn as RawColumn,
    RawTable as RawTable,
    TableBytes as TableBytes,
    astropy_table as astropy_table,
    column_of as column_of,
    parse_table as parse_table,
    read_bytes as read_bytes,
)
from catalogs.user_tables import OwnTables as OwnTables, tables_read as tables_read
from catalogs.velocity_limits import (
    VELOCITY_AXES_AU as VELOCITY_AXES_AU,
    VelocityLimit as VelocityLimit,
    amplitude_m_s as amplitude_m_s,
    velocity_limit as velocity_limit,
)
from cpic_core.errors import InputError as InputError
