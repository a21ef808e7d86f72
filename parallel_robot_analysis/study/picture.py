"""The empirical distributions of the error, one curve a law, one panel a scenario."""

from __future__ import annotations

import io
from collections.abc import Mapping

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from parallel_robot_analysis.report.labels import law_label
from parallel_robot_analysis.report.palette import RUNS
from parallel_robot_analysis.study import statistics
from parallel_robot_analysis.study.results import ScenarioResult
from parallel_robot_bags.printable_output import without_mathematics

SIZE = (7.0, 3.6)  # inches, of one panel


def draw(results: Mapping[str, ScenarioResult]) -> dict[str, bytes]:
    """Draw the distributions.

    Returns:
        Suffix to content, of a PNG and a PDF.
    """
    figure = Figure(figsize=(SIZE[0], SIZE[1] * len(results)), layout='constrained')
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(results), 1, squeeze=False)[:, 0]
    for panel, (scenario, result) in zip(panels, results.items(), strict=True):
        for k, (law, found) in enumerate(result.laws.items()):
            values, shares = statistics.distribution(found.errors)
            style = RUNS[k % len(RUNS)]
            dashes = (0, style.dash) if style.dash else 'solid'
            panel.step(
                values,
                shares,
                where='post',
                color=style.light,
                linestyle=dashes,
                linewidth=1.4 if k < len(RUNS) else 0.8,
                label=without_mathematics(law_label(law)),
            )
        panel.set_xscale('log')
        panel.set_ylim(0.0, 1.0)
        panel.set_title(without_mathematics(scenario), fontsize=10)
        error = result.quantities[0]
        panel.set_xlabel(f'{error.name} [{error.unit}]')
        panel.set_ylabel('share of the runs below')
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7, loc='center left', bbox_to_anchor=(1.0, 0.5))
    pictures = {}
    for suffix in ('png', 'pdf'):
        stream = io.BytesIO()
        figure.savefig(
            stream,
            format=suffix,
            dpi=150,
            metadata={'CreationDate': None} if suffix == 'pdf' else None,
        )
        pictures[suffix] = stream.getvalue()
    return pictures
