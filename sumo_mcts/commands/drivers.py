"""The command drivers: how good probabilities of what drivers do are, and the weights of models."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts import records
from sumo_mcts.errors import ConfigError
from sumo_mcts.evaluation.lane_changes import FEATURES, WEIGHTS
from sumo_mcts.evaluation.reliability import scores
from sumo_mcts.scenarios import Note, naming_source, resolve_each
from sumo_mcts.situations import FAMILIES
from sumo_mcts.studies.drivers import CHANGES, Sample, answers, joined, judged
from sumo_mcts.studies.logistic import fitted, probability


class DriversPlan(NamedTuple):
    """What `drivers` is to do."""

    families: tuple[str, ...]  # of drivers; empty: the scenarios' own
    first: int  # seed
    seeds: int
    fit: bool


def drivers(
    scenarios: Sequence[str], egos: Sequence[str], until: str | None, overrides: tuple[str, ...],
    plan: DriversPlan, note: Note, *,
    allow_plugins: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Judge what the forecasts of planner `mcts` say about drivers, in an episode for each
    scenario, family and seed. Raises ConfigError."""
    found: defaultdict[str, list[Sample]] = defaultdict(list)
    outcomes, problems = Counter[str](), list[str]()
    sets: list[tuple[str, ...]] = [(f"sumo.dense.family={name}",) for name in plan.families] or [()]
    seeds = range(plan.first, plan.first + plan.seeds)
    for name in scenarios:
        for more in sets:
            for config in resolve_each(
                name,
                egos,
                until,
                (*overrides, *more, "planner.name=mcts"),
                (),
                allow_plugins=allow_plugins,
            ):
                for seed in seeds:
                    note(f"{config.name} {' '.join(more)} seed {seed}")
                    with naming_source(name, config.sumo.sumocfg):
                        episode = answers(config, seed)
                    outcomes += episode.outcomes
                    problems += episode.problems
                    for question, sample in episode.samples.items():
                        found[question].append(sample)
    samples = {question: joined(parts) for question, parts in found.items()}
    return {
        "schema_version": records.SCHEMA_VERSION,
        "scenarios": list(scenarios),
        "families": list(plan.families),
        "seeds": list(seeds),
        "outcomes": dict(outcomes),
        "problems": problems,
        "questions": [row for question, each in samples.items() for row in _rows(question, each)],
        **({"weights": weights(samples)} if plan.fit else {}),
    }


def families(text: str | None) -> tuple[str, ...]:
    """The families in `krauss,idm`. Raises ConfigError."""
    names = tuple(text.split(",")) if text else ()
    for name in names:
        if name not in FAMILIES:
            raise ConfigError(f"--families {text}: {', '.join(FAMILIES)}, separated by commas")
    return names


def _rows(question: str, sample: Sample) -> list[dict[str, Any]]:
    """The scores of the planner's forecast, and of the model where there is one."""
    rows = [{"question": question, "by": "forecast", **scores(judged(sample))}]
    if question in CHANGES:
        model = probability(sample.seen, WEIGHTS[CHANGES.index(question)])
        rows.append({"question": question, "by": "model", **scores(judged(sample, model))})
    return rows


def weights(samples: Mapping[str, Sample]) -> dict[str, list[float]]:
    """By feature: what it adds to the logarithm of the odds of a change to the right and left."""
    sides = [
        fitted(samples[name].seen, samples[name].happened)
        if name in samples
        else np.zeros(len(FEATURES))
        for name in CHANGES
    ]
    return {
        feature: [round(float(side[k]), 2) for side in sides] for k, feature in enumerate(FEATURES)
    }


def table(document: dict[str, Any]) -> str:
    """The scores for a person, as Markdown: a row for each question, then the reliability of
    each."""
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in document["outcomes"].items())
    head = f"{', '.join(document['scenarios'])}: {outcomes}"
    lines = [
        head,
        "",
        "| question | by | asked | happened | Brier score | skill |",
        "|---|---|---|---|---|---|",
        *(
            f"| {row['question']} | {row['by']} | {row['asked']} | {row['happened']} | "
            f"{_number(row['brier'], 4)} | {_number(row['skill'], 3)} |"
            for row in document["questions"]
        ),
        "",
        "| question | by | predicted | asked | on average | happened (95 % Wilson) |",
        "|---|---|---|---|---|---|",
        *(line for row in document["questions"] for line in _reliability_lines(row)),
    ]
    if "weights" in document:
        lines += ["", *(f"{name}: {both}" for name, both in document["weights"].items())]
    return "\n".join(lines)


def _reliability_lines(row: dict[str, Any]) -> list[str]:
    return [
        f"| {row['question']} | {row['by']} | {each['from']:g}..{each['to']:g} | {each['asked']} | "
        f"{each['predicted']:.3f} | {each['happened'] / each['asked']:.3f} "
        f"({each['interval'][0]:.3f}..{each['interval'][1]:.3f}) |"
        for each in row["reliability"]
    ]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
