import numpy as np
import pytest

from simulator.config import load_instrument


@pytest.fixture(scope="session")
def cosmic():
    """The default cosmic rays with another model and some numbers of its sections changed."""
    default = load_instrument().cosmic_rays

    def changed(model, **sections):
        tree = default.model_dump() | {"model": model}
        for name, values in sections.items():
            tree[name] = tree[name] | values
        return type(default).model_validate(tree)

    return changed


@pytest.fixture
def rng():
    return np.random.default_rng(20280101)
