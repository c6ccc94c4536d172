"""Offline trials of an item, as in the published code or on recorded percepts."""

from collections.abc import Mapping, Sequence

from meal_bayes import OfflineConfig, run_offline
from meal_bayes.evaluation import difference, mean
from meal_bayes.trial_log import TrialOutcomes
from paper_repro import published
from paper_repro.frame import HERE, Cell, Estimate, Setting, Table, paper_values

AGAINST = "morc"  # the paper's agent, which others are compared with
MEASURES = ("success", "cost", "reward")
_CLASSIFIERS = {"roc36": "paper"}  # whose percept tables the published protocol draws from

Runs = Mapping[str, TrialOutcomes]  # by agent


def domain_path(name: str) -> str:
    """Return the path of a domain table of this folder."""
    return str(HERE / "domains" / f"{name}.toml")


def run_agent(
    setting: Setting,
    protocol: str,
    dataset: str,
    n: int,
    agent: str,
    trials: int,
    *,
    domain: str = "",
    perception: str = "",
    reward: float | None = None,
) -> TrialOutcomes:
    """Run an agent's trials, or read those that the logs hold.

    Parameters
    ----------
    setting : seed, processes, logs.
    protocol : "published" or "recorded".
    dataset : roc36, ispy32 or cy101.
    n : attributes a query.
    agent, trials : who, and how many in all.
    domain : a domain or the path of its table, in place of the protocol's.
    perception : "default" or "paper", in place of the protocol's.
    reward : of a right report, in place of the paper's.
    """
    code = protocol == "published"
    theirs = code and not setting.quick
    if code and (dataset, agent) == ("roc36", "random"):
        domain = domain_path("roc36_every_action")  # where illegal actions cost their time
    config = OfflineConfig(
        domain or (f"{dataset}_published" if code else dataset),
        attributes=n,
        trials=trials,
        agents=(published.AGENTS.get(agent, agent) if code else agent,),
        seed=setting.seed,
        percepts="model" if code else "recorded",
        perception=perception or (_CLASSIFIERS.get(dataset, "default") if theirs else "default"),
        reward=paper_values("offline_reward") if reward is None else reward,
    )
    done = run_offline(
        config, logs=setting.logs, jobs=setting.jobs, cluster=setting.cluster,
        on_progress=setting.on_progress,
    )  # fmt: skip
    setting.spend(done.paths)
    return done.outcomes()


def estimate(outcomes: TrialOutcomes, measure: str) -> Estimate:
    """Estimate the mean of "success", "cost" or "reward"; objects are clusters."""
    return Estimate.of(mean(outcomes, measure))


def paired_table(runs: Mapping[str, Runs], agents: Sequence[str]) -> Table:
    """Compare agents with MORC on the same tasks, a column a run."""
    rows: list[tuple[Cell, ...]] = []
    for agent in agents:
        found = [difference(own[agent], own[AGAINST]) for own in runs.values()]
        rows.append((agent, *map(Estimate.of, found)))
    return Table(f"reward less that of {AGAINST}, paired", ("agent", *runs), tuple(rows))
