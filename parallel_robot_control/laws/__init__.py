"""The laws of the suite by name. A new one is one module here."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from parallel_robot_control.contract import Law
from parallel_robot_model.processes.custom_module import classes_of, qualify_type_names

PAPER = ('smc', 's_smc', 'nftsmc', 's_fotsmc')  # Doan, Le, Vo (2019)
FIRST = (  # in tables and menus; all others follow by their names
    *PAPER,
    *('smc_k', 'fotsmc'),  # its ablations: the same without coupling
    *('pid', 'computed_torque', 'super_twisting'),  # baselines
    *('adaptive_s_fotsmc', 's_fotsmc_ft'),  # extensions
    # rivals that estimate the disturbance, or settle in fixed time
    *('adrc', 'tdc', 'fixed_time_smc', 'syn_tde_nftsmc'),
    *('continuous_twisting', 'predefined_time_smc'),
    # discretised by backward Euler
    *('implicit_smc', 'implicit_s_fotsmc', 'implicit_super_twisting'),
    # for the laboratory: on the motion and the disturbance that a Kalman filter predicts
    *('observer_s_fotsmc', 'lqg_tracking', 'calm_tracking'),
)


def _law(name: str) -> Law:
    law = Law.of(import_module(f'{__name__}.{name}'))
    qualify_type_names(*classes_of(law))  # before a kernel makes a tuple of one
    return law


_names = sorted(file.stem for file in Path(__file__).parent.glob('[a-z]*.py'))
LAWS = {name: _law(name) for name in dict.fromkeys((*FIRST, *_names))}
TITLES = {name: law.TITLE or name for name, law in LAWS.items()}
CUSTOM_TITLES: dict[str, str] = {}  # of custom laws that this process knows, see law_loader.py


def title(law: str) -> str:
    """How a law is written in pictures and reports: S-FOTSMC for s_fotsmc; any other as it is."""
    return TITLES.get(law) or CUSTOM_TITLES.get(law, law)
