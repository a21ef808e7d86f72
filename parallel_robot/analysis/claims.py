"""The paper's claims about its four laws, each verified by a metric."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from parallel_robot.analysis.metrics import Metric, Metrics, named

SCENARIOS = ('paper_circle', 'paper_line')  # the paper's


class Claim(NamedTuple):
    """A law is said to be better than others in one metric."""

    text: str  # what the paper says
    better: str  # the law that is said to be better
    others: tuple[str, ...]  # the laws it is said to be better than
    metric: str  # key of the metric that is compared

    @property
    def unit(self) -> str:
        """Unit of the metric as it is printed."""
        return self.row.unit

    @property
    def row(self) -> Metric:
        """The metric."""
        return named(self.metric)[0]


class Verdict(NamedTuple):
    """A claim beside what was measured."""

    claim: Claim
    reproduced: bool  # whether `better` is better than all `others`
    values: dict[str, float]  # law to value, in the unit of the claim


OTHERS = ('smc', 's_smc', 'nftsmc')
ERROR, TIME, APART, ROUGH = 'xy_rms_m', 'to_1_mm_s', 'sync_rms_rad', 'chattering_nm'
FASTER = 'NFTSMC converges faster than SMC and S-SMC (to 1 mm)'
CLAIMS = (
    Claim('S-SMC tracks better than SMC', 's_smc', ('smc',), ERROR),
    Claim('NFTSMC tracks better than SMC', 'nftsmc', ('smc',), ERROR),
    Claim('NFTSMC tracks better than S-SMC', 'nftsmc', ('s_smc',), ERROR),
    Claim(FASTER, 'nftsmc', ('smc', 's_smc'), TIME),
    Claim('S-FOTSMC tracks best of the four', 's_fotsmc', OTHERS, ERROR),
    Claim('S-FOTSMC converges fastest of the four (to 1 mm)', 's_fotsmc', OTHERS, TIME),
    Claim('S-FOTSMC synchronises the joints best of the four', 's_fotsmc', OTHERS, APART),
    Claim('NFTSMC still chatters, S-FOTSMC does not', 's_fotsmc', ('nftsmc',), ROUGH),
)


def verify(scenario: str, results: Mapping[str, Metrics]) -> list[Verdict]:
    """Verify the claims whose laws have results; none for scenarios that are not the paper's.

    Args:
        scenario: Name of the scenario.
        results: Law to its metrics.
    """
    verdicts = []
    for claim in CLAIMS if scenario in SCENARIOS else ():
        laws = (claim.better, *claim.others)
        if all(law in results for law in laws):
            values = {law: claim.row.printed(results[law]) for law in laws}
            if any(math.isnan(value) for value in values.values()):
                continue  # not defined for the robot of the runs
            ahead = all(values[claim.better] < values[law] for law in claim.others)
            verdicts.append(Verdict(claim, ahead, values))
    return verdicts
