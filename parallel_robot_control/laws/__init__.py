"""The laws of the suite by name. A new one is one module, and one line in each table here."""

from __future__ import annotations

from parallel_robot_control.contract import Law
from parallel_robot_control.laws import (
    adaptive_s_fotsmc,
    adrc,
    calm_tracking,
    computed_torque,
    continuous_twisting,
    fixed_time_smc,
    fotsmc,
    implicit_s_fotsmc,
    implicit_smc,
    implicit_super_twisting,
    lqg_tracking,
    nftsmc,
    observer_s_fotsmc,
    pid,
    predefined_time_smc,
    s_fotsmc,
    s_fotsmc_ft,
    s_smc,
    smc,
    smc_k,
    super_twisting,
    syn_tde_nftsmc,
    tdc,
)
from parallel_robot_model.processes.custom_module import classes_of, distinguish

LAWS: dict[str, Law] = {
    # the paper's
    'smc': smc,
    's_smc': s_smc,
    'nftsmc': nftsmc,
    's_fotsmc': s_fotsmc,
    # its ablations: the same without coupling
    'smc_k': smc_k,
    'fotsmc': fotsmc,
    # baselines
    'pid': pid,
    'computed_torque': computed_torque,
    'super_twisting': super_twisting,
    # extensions
    'adaptive_s_fotsmc': adaptive_s_fotsmc,
    's_fotsmc_ft': s_fotsmc_ft,
    # rivals that estimate the disturbance, or settle in fixed time
    'adrc': adrc,
    'tdc': tdc,
    'fixed_time_smc': fixed_time_smc,
    'syn_tde_nftsmc': syn_tde_nftsmc,
    'continuous_twisting': continuous_twisting,
    'predefined_time_smc': predefined_time_smc,
    # discretised by backward Euler
    'implicit_smc': implicit_smc,
    'implicit_s_fotsmc': implicit_s_fotsmc,
    'implicit_super_twisting': implicit_super_twisting,
    # for the laboratory: on the motion and the disturbance that a Kalman filter predicts
    'observer_s_fotsmc': observer_s_fotsmc,
    'lqg_tracking': lqg_tracking,
    'calm_tracking': calm_tracking,
}

for _law in LAWS.values():
    distinguish(*classes_of(_law))  # before a kernel makes a tuple of one

PAPER = ('smc', 's_smc', 'nftsmc', 's_fotsmc')  # Doan, Le, Vo (2019)

TITLES = {
    'smc': 'SMC',
    's_smc': 'S-SMC',
    'nftsmc': 'NFTSMC',
    's_fotsmc': 'S-FOTSMC',
    'smc_k': 'SMC-K',
    'fotsmc': 'FOTSMC',
    'pid': 'PID',
    'computed_torque': 'computed torque',
    'super_twisting': 'super-twisting',
    'adaptive_s_fotsmc': 'adaptive S-FOTSMC',
    's_fotsmc_ft': 'S-FOTSMC-FT',
    'adrc': 'ADRC',
    'tdc': 'TDC',
    'fixed_time_smc': 'fixed-time SMC',
    'syn_tde_nftsmc': 'Syn-TDE-NFTSMC',
    'continuous_twisting': 'continuous twisting',
    'predefined_time_smc': 'predefined-time SMC',
    'implicit_smc': 'implicit SMC',
    'implicit_s_fotsmc': 'implicit S-FOTSMC',
    'implicit_super_twisting': 'implicit super-twisting',
    'observer_s_fotsmc': 'observer S-FOTSMC',
    'lqg_tracking': 'LQG tracking',
    'calm_tracking': 'calm tracking',
}

CUSTOM_TITLES: dict[str, str] = {}  # of custom laws that this process knows, see law_loader.py


def title(law: str) -> str:
    """How a law is written in pictures and reports: S-FOTSMC for s_fotsmc; any other as it is."""
    return TITLES.get(law) or CUSTOM_TITLES.get(law, law)
