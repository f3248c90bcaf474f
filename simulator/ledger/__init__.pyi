from simulator.ledger.choice import (
    SUM_EPOCHS as SUM_EPOCHS,
    Choice as Choice,
    Shortcuts as Shortcuts,
    budget_of as budget_of,
    checked_quantities as checked_quantities,
    choose as choose,
    error_of as error_of,
    observation_choice as observation_choice,
)
from simulator.ledger.inventory import (
    EffectRow as EffectRow,
    camera_ledger as camera_ledger,
    effect_ledger as effect_ledger,
    not_modelled as not_modelled,
    sky_ledger as sky_ledger,
)
from simulator.ledger.visit import (
    MAX_EPOCHS as MAX_EPOCHS,
    NOT_IN_SUMS as NOT_IN_SUMS,
    Forecast as Forecast,
    forecast as forecast,
)
