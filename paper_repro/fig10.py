"""Fig. 10: learning curves on three data sets, one and two attributes."""

from frame import Claim, Result, Setting, asked, main
from online import OURS, PAPERS, compared, curve, panel

from meal_bayes.evaluation import canvas, plots, summarize_learning
from meal_bayes.trial_log import BatchOutcomes

BEST, BASE = "morc_itrs", "iterative_morc"
NOTE = """The paper has MORC-ITRS on top along the whole curve. Here that stands where the 90 %
interval of its hours ratio lies above 1: the hours in which Iterative MORC reaches its own final
accuracy, over those of MORC-ITRS. Accuracy and ECE are those of the last three batches, the rest
after the last; claimed is an agent's own mean Pr(its report is right). In the published protocol
percepts are drawn from the learned tables, which are cross-validated over samples."""


def run(setting: Setting) -> Result:
    """Run every panel; the published code's protocol beside it where settings.toml says so."""
    tables, figures, claims, words = [], {}, [], []
    for name in setting.of("fig10", "panels"):
        dataset, n = name.split("_")
        title = f"{dataset.upper()}, {asked(int(n))}"
        own: list[BatchOutcomes] | None = None
        code: list[BatchOutcomes] | None = None
        again = setting.of("fig10", "published").get(name, 0)
        if again:
            run = panel(setting, dataset, int(n), PAPERS[1:], again, published=True)
            code = list(run.results())
            tables.append(compared(f"{title}, published protocol", code))
            figures[f"_{name}_published"] = _figure(code, PAPERS[1:])
        if not setting.as_published:
            repeats = setting.of("fig10", "repeats")[name]
            own = list(panel(setting, dataset, int(n), (*PAPERS, *OURS), repeats).results())
            tables.append(compared(f"{title}, {repeats} repeats", own))
            figures[f"_{name}"] = _figure(own, (*PAPERS, *OURS))
            words.append(f"{name} {_ratio(own)[0]:.2f}")
        text = f"{title}: MORC-ITRS on top"
        claims.append(Claim(text, _above(own), _above(code)))
    return Result(
        item="fig10",
        title="Learning curves, accuracy against hours of exploration",
        paper="MORC-ITRS on top along the whole curve, in all six panels",
        ours="hours ratios of MORC-ITRS: " + ", ".join(words),
        tables=tuple(tables),
        claims=tuple(claims),
        notes=(NOTE.replace("\n", " "),),
        figures=figures,
    )


def _ratio(results: list[BatchOutcomes]) -> tuple[float, float]:
    (one,) = (s for s in summarize_learning(results, reference=BASE) if s.agent == BEST)
    return one.hours_ratio, one.hours_ratio_low


def _above(results: list[BatchOutcomes] | None) -> bool | None:
    return None if results is None else _ratio(results)[1] > 1


def _figure(results: list[BatchOutcomes], agents: tuple[str, ...]) -> canvas.Axes:
    return plots.learning_curve([curve(results, agent) for agent in agents])


if __name__ == "__main__":
    main(run)
