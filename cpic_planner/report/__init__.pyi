from cpic_planner.report.answers import (
    best_row as best_row,
    check_figure_name as check_figure_name,
    etc_curves as etc_curves,
    etc_figure as etc_figure,
    print_both as print_both,
    print_etc as print_etc,
    print_fidelity as print_fidelity,
    print_tradeoff as print_tradeoff,
    question_text as question_text,
    write_figure as write_figure,
)
from cpic_planner.report.cells import (
    Cells as Cells,
    Sheet as Sheet,
    displayable as displayable,
    form_text as form_text,
    offered_text as offered_text,
    print_plain as print_plain,
)
from cpic_planner.report.confirm import (
    calibration_sentence as calibration_sentence,
    outcome_text as outcome_text,
    print_confirm as print_confirm,
)
from cpic_planner.report.document import (
    Block as Block,
    Cell as Cell,
    Facts as Facts,
    Figure as Figure,
    Fold as Fold,
    Heading as Heading,
    Items as Items,
    Paragraph as Paragraph,
    Table as Table,
    code as code,
    lines as lines,
    page_link as page_link,
    small as small,
    strong as strong,
    templates as templates,
)
from cpic_planner.report.drawing import (
    Picture as Picture,
    new_figure as new_figure,
    place_labels as place_labels,
    save as save,
    style as style,
)
from cpic_planner.report.files import (
    PANELS as PANELS,
    PRODUCTS as PRODUCTS,
    WHATIF_PRODUCTS as WHATIF_PRODUCTS,
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
    print_known as print_known,
    print_visibility as print_visibility,
    visibility_csv as visibility_csv,
    visibility_figure as visibility_figure,
)
from cpic_planner.report.plan import print_plan as print_plan, star_blocks as star_blocks
from cpic_planner.report.plotted import Panel as Panel, panels_of as panels_of, values_blocks as values_blocks
from cpic_planner.report.ranking import (
    TIERS as TIERS,
    print_explanation as print_explanation,
    print_moves as print_moves,
    print_rank as print_rank,
    print_sensitivity as print_sensitivity,
    priority_blocks as priority_blocks,
    ranking_csv as ranking_csv,
    ranking_ecsv as ranking_ecsv,
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
    print_curve as print_curve,
    print_roc as print_roc,
    roc_figure as roc_figure,
    write_curve as write_curve,
    write_roc as write_roc,
)
from cpic_planner.report.simulation import (
    print_check as print_check,
    print_columns as print_columns,
    print_instrument as print_instrument,
    print_planned as print_planned,
    print_simulation as print_simulation,
)
from cpic_planner.report.whatif import (
    best_by_value as best_by_value,
    hanging_text as hanging_text,
    print_whatif as print_whatif,
)
from cpic_planner.report.words import (
    MISSING as MISSING,
    duration_text as duration_text,
    full_name as full_name,
    level_text as level_text,
    pretty_name as pretty_name,
)
