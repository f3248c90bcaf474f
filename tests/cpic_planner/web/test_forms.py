import pytest

from cpic_core import InputError
from cpic_planner.web.addresses import ETC, RANK
from cpic_planner.web.forms import ETC_GROUPS, RANK_GROUPS, etc_form, rank_form


@pytest.mark.parametrize(("asking", "layout"), [(ETC, ETC_GROUPS), (RANK, RANK_GROUPS)])
def test_forms_offer_what_may_be_asked(asking, layout):
    for _, names, _ in layout:
        for name in names.split():
            assert asking.by_name[name].flag not in asking.left_out


def fields(form):
    return {field.name: field for group in form.groups for field in group.fields}


def test_a_form_is_filled_with_what_was_asked():
    given = [("target", "tau Cet"), ("separation_arcsec", "0.4"), ("separation_arcsec", "0.5"), ("band", "F520")]
    filled = fields(etc_form(given))
    assert filled["target"].values == ("tau Cet",)
    assert filled["separation_arcsec"].values == ("0.4, 0.5",)
    assert filled["bands"].values == ("F520",)
    assert filled["snr"].values == ()
    assert not etc_form(given).groups[-1].open


def test_an_error_stands_at_its_field_and_opens_the_fold_or_above_all():
    form = etc_form([("em_gain", "x")], InputError("em_gain", "x", allowed="a number"))
    assert "em_gain = x" in fields(form)["em_gain"].error
    assert (form.groups[-1].open, form.error) == (True, "")
    assert "nonsense" in etc_form([], InputError("nonsense", "x")).error
    ranked = rank_form([("limit", "x")], InputError("limit", "x", allowed="1 to 1500"))
    assert "limit = x" in fields(ranked)["limit"].error
    assert ranked.error == ""


def test_no_hint_of_a_form_offers_a_file():
    for form in (etc_form(()), rank_form(())):
        for name, field in fields(form).items():
            assert "file" not in field.hint.lower(), name
