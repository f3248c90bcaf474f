from cpic_planner.report.answers import (
    best_row as best_row,
    both_blocks as both_blocks,
    check_figure_name as check_figure_name,
    etc_blocks as etc_blocks,
    etc_curves as etc_curves,
    etc_figure as etc_figure,
    etc_stars_blocks as etc_stars_blocks,
    question_text as question_text,
    tradeoff_blocks as tradeoff_blocks,
    write_figure as write_figure,
)
from cpic_planner.report.compared import comparison_blocks as comparison_blocks, comparison_page as comparison_page
from cpic_planner.report.confirm import (
    calibration_sentence as calibration_sentence,
    confirm_blocks as confirm_blocks,
    outcome_text as outcome_text,
)
from cpic_planner.report.document import (
    Block as Block,
    Facts as Facts,
    Figure as Figure,
    Fold as Fold,
    Heading as Heading,
    Items as Items,
    Paragraph as Paragraph,
    Table as Table,
    code as code,
    facts_of as facts_of,
    lines as lines,
    own_column as own_column,
    page_link as page_link,
    small as small,
    strong as strong,
)
from cpic_planner.report.drawing import (
    Picture as Picture,
    new_figure as new_figure,
    place_labels as place_labels,
    save as save,
    style as style,
)
from cpic_planner.report.export import EXPORT as EXPORT
from cpic_planner.report.files import (
    PANELS as PANELS,
    SOURCES_FILES as SOURCES_FILES,
    WHATIF_PRODUCTS as WHATIF_PRODUCTS,
    plan_products as plan_products,
    products_of as products_of,
    write_confirm_report as write_confirm_report,
    write_report as write_report,
    write_star_images as write_star_images,
    write_whatif as write_whatif,
)
from cpic_planner.report.image_figures import in_both_lights as in_both_lights
from cpic_planner.report.known import (
    known_blocks as known_blocks,
    known_figure as known_figure,
    visibility_blocks as visibility_blocks,
    visibility_csv as visibility_csv,
    visibility_figure as visibility_figure,
    window_blocks as window_blocks,
)
from cpic_planner.report.plan import plan_blocks as plan_blocks, star_blocks as star_blocks
from cpic_planner.report.plotted import Panel as Panel, panels_of as panels_of, values_blocks as values_blocks
from cpic_planner.report.ranking import (
    TIERS as TIERS,
    explanation_blocks as explanation_blocks,
    move_blocks as move_blocks,
    priority_blocks as priority_blocks,
    rank_blocks as rank_blocks,
    ranking_csv as ranking_csv,
    ranking_ecsv as ranking_ecsv,
    sensitivity_blocks as sensitivity_blocks,
)
from cpic_planner.report.ranking_figures import (
    MOST_STARS as MOST_STARS,
    ensemble_figure as ensemble_figure,
    rank_figure as rank_figure,
)
from cpic_planner.report.searches import (
    CURVE_PRODUCTS as CURVE_PRODUCTS,
    ROC_PRODUCTS as ROC_PRODUCTS,
    curve_figure as curve_figure,
    roc_figure as roc_figure,
    search_blocks as search_blocks,
    write_curve as write_curve,
    write_roc as write_roc,
)
from cpic_planner.report.simulation import (
    check_blocks as check_blocks,
    columns_blocks as columns_blocks,
    instrument_blocks as instrument_blocks,
    planned_blocks as planned_blocks,
    reduction_blocks as reduction_blocks,
    simulation_blocks as simulation_blocks,
)
from cpic_planner.report.whatif import (
    best_by_value as best_by_value,
    hanging_text as hanging_text,
    whatif_blocks as whatif_blocks,
)
from cpic_planner.report.words import (
    MISSING as MISSING,
    duration_text as duration_text,
    full_name as full_name,
    level_text as level_text,
    pretty_name as pretty_name,
)
from cpic_planner.report.writing import (
    chosen as chosen,
    displayable as displayable,
    first_table as first_table,
    form_text as form_text,
    offered_text as offered_text,
    print_blocks as print_blocks,
    print_lines as print_lines,
    print_table as print_table,
    templates as templates,
)
