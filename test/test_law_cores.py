"""A law that was made once is made again without the compiler, with the same result."""

from collections import Counter

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.typing import typeof as typing_module

from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_control.prepared_law import with_gains
from parallel_robot_model.compiler import vectors
from parallel_robot_model.configuration import config
from trajectory_gen.configuration import trajectory_of

MS = 10**6  # ns
START = 10**9  # ns
CHANGED = {'s_fotsmc.G': 12.0}


def controller(**changes):
    return Controller(configure(config.resolve('paper_circle', changes)))


@pytest.fixture(scope='module')
def made():
    """A controller that has made two laws."""
    core = controller()
    for law in ('smc', 's_fotsmc'):
        core.apply(core.prepare_change({'law': law}))
    return core


@pytest.fixture
def counts(monkeypatch):
    """How often Numba prepares to compile, and is asked for the type of a value of which class."""
    counted = Counter()
    compile_, type_of = Dispatcher.compile, typing_module.typeof_impl

    def compiling(self, signature):
        counted['compiled'] += 1
        return compile_(self, signature)

    def typing(value, context):
        counted[type(value).__name__] += 1
        return type_of(value, context)

    monkeypatch.setattr(Dispatcher, 'compile', compiling)
    for module in (typing_module, vectors):
        monkeypatch.setattr(module, 'typeof_impl', typing)
    return counted


def torques(core):
    """Torques of 50 states that lag a little behind their references."""
    samples = trajectory_of(config.resolve('paper_circle')).sample(np.arange(50) * 1e-3)
    rows = zip(samples.position, samples.velocity, samples.acceleration, strict=True)
    found = []
    for k, row in enumerate(rows):
        core.add_reference(START + k * MS, JointReference(*row))
        state = row[0] - 1e-3, row[1], np.zeros(3)
        assert core.add_state(START + k * MS, state)
        found.append(core.torque)
    return np.array(found)


def test_a_switch_to_a_law_that_was_made_compiles_and_types_nothing(made, counts):
    for law in ('smc', 's_fotsmc', 'smc'):
        change = made.prepare_change({'law': law})
        made.apply(change)
        assert made.law.name == law
    assert not counts


def test_for_new_gains_only_these_are_typed(made, counts):
    change = made.prepare_change({**CHANGED, 'law': 's_fotsmc'})
    assert change.law.gains.G == 12.0
    assert set(counts) == {type(change.law.gains).__name__, 'float', 'Boxed'}


@pytest.mark.parametrize('gain', ['s_fotsmc.G', 's_fotsmc.lambda'])
def test_new_gains_act_as_those_of_the_start(gain):
    value = 1.1 * config.resolve('paper_circle')[gain]
    core = controller(law='s_fotsmc')
    usual = core.prepare_change({'law': 's_fotsmc'})
    core.apply(core.prepare_change({gain: value}))
    changed = torques(core)
    assert np.array_equal(changed, torques(controller(law='s_fotsmc', **{gain: value})))
    assert not np.array_equal(changed, torques(controller(law='s_fotsmc')))
    assert usual.compiled.setup.safety.value is core.limits


def test_a_law_that_is_made_again_begins_with_an_empty_memory():
    core = controller(law='s_fotsmc')
    torques(core)
    empty, remembered = core.law.memory.first, core.law.memory.current
    assert not same(remembered, empty)
    core.apply(core.prepare_change({'law': 'pid'}))
    change = core.prepare_change({'law': 's_fotsmc'})
    assert same(change.law.memory.current, remembered)  # it has not taken effect
    core.apply(change)
    assert same(core.law.memory.current, empty)


def same(some, others):
    return all(map(np.array_equal, some, others))


def test_a_custom_law_is_tried_with_its_new_gains(made):
    gains = made.law.gains
    custom = made.law._replace(name='own')
    law = made.configuration.laws[made.law.name]
    assert with_gains(custom, law, gains) is custom
    assert with_gains(custom, law, type(gains)(*gains)) is None
