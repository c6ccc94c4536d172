"""Kernels of the exact Bayes error of an open-loop plan: E min(b, 1 - b) after its percepts.

The leaf of the tree search (`leaf.py`) and the plan library (`plan_library.py`) stand on these.
"""

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import config
from numpy.typing import NDArray

from meal_bayes.cache import compile_kernel

OUTCOMES = 1024  # joint outcomes of a plan that are held for one attribute
BINS = 64  # to which they are merged, by likelihood ratio, before there would be more
WIDEST = 12.0  # log likelihood ratios beyond are merged
SPAN = 16.0  # log-odds covered by the tables of decision rules


@contextmanager
def lightly_optimized() -> Iterator[None]:
    """Compile with less of LLVM's effort: half the time, and nothing here runs slower for it."""
    before = config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE
    config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE = 1, 0, 0
    try:
        yield
    finally:
        config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE = before


def _sources() -> str:
    """Digest of all kernels' sources and types."""
    files = ("compiled.py", "bayes_error.py", "leaf.py", "search.py")
    text = b"".join(Path(__file__).with_name(name).read_bytes() for name in files)
    return hashlib.blake2b(text, digest_size=8).hexdigest()


_SOURCES = _sources()


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel when it is called first; later processes load it.

    Nothing here allocates, so there are no references to count, half of what there would be to
    compile: callers bring the room (`Work`). numba's cache looks at the file of a kernel alone,
    but kernels call kernels of other files, so their digest is made part of its version.
    """
    compiled = compile_kernel(function, nogil=True, error_model="numpy", _nrt=False)
    held = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if held is not None:  # it is None where compilation is switched off
        held._version = f"{held._version} {_SOURCES}"
    return compiled


class Work(NamedTuple):
    """Room for one caller's intermediate results."""

    outcomes: NDArray[np.float64]  # (C,OUTCOMES) Pr(what a plan's percepts show, kind)
    counts: NDArray[np.float64]  # (C,OUTCOMES)
    truths: NDArray[np.float64]  # (2,OUTCOMES) Pr(what a plan's percepts show, truth)
    yes: NDArray[np.float64]  # (N,E) yes-percepts seen
    total: NDArray[np.float64]  # (E,) percepts seen
    seen: NDArray[np.float64]  # (N,E,K)
    weight: NDArray[np.float64]  # (N,C) Pr(kind)
    chance: NDArray[np.float64]  # (N,) Pr(attribute is true)
    cell: NDArray[np.int64]  # (N,) where in the tables the best rule was found last
    levels: NDArray[np.int64]  # (N,)
    uses: NDArray[np.int64]  # (2,E) percepts of a plan, and of the plan with one step more
    useful: NDArray[np.bool_]  # (E,)
    computed: NDArray[np.int64]  # (E,) how many of them were computed
    guess: NDArray[np.float64]  # (J,) what the tables say of plans that they do not hold
    path: NDArray[np.int64]  # (DEPTH,2) nodes and behaviors of a descent


@kernel
def truth(problem, weight, row, i):
    """Pr(attribute i is true): its share of every kind."""
    total = 0.0
    for c in range(weight.shape[2]):
        total += weight[row, i, c] * problem.share[i, 1, c]
    return total


@kernel
def _yes_counts(problem, i, c, e, k, yes, total, out):
    """Pr(j of the next k percepts say yes | kind, percepts seen), j = 0..k: a Polya urn."""
    levels = problem.confusion.shape[3]
    p = 0.0
    for z in range(levels // 2, levels):
        p += problem.confusion[i, e, c, z]
    s = problem.precision[i, e, c]
    out[0] = 1.0
    for t in range(k):
        out[t + 1] = 0.0
        for j in range(t, -1, -1):
            q = p if np.isinf(s) else (s * p + yes + j) / (s + total + t)
            w = out[j]
            out[j + 1] += w * q
            out[j] = w * (1.0 - q)


@kernel
def _by_truth(share, i, m, work):
    """Sum m outcomes over the kinds, of which each truth has a share (N,2,C) -> `work.truths`."""
    outcomes, truths = work.outcomes, work.truths
    for v in range(2):
        for a in range(m):
            truths[v, a] = 0.0
    for c in range(outcomes.shape[0]):
        false, true = share[i, 0, c], share[i, 1, c]
        for a in range(m):
            truths[0, a] += outcomes[c, a] * false
            truths[1, a] += outcomes[c, a] * true


@kernel
def _speaks(truths, a):
    """Log ratio of truth and untruth of an outcome."""
    return np.log((truths[1, a] + 1e-300) / (truths[0, a] + 1e-300))


@kernel
def _bins(outcomes):
    """So many bins are merged to: fewer where there is room for fewer outcomes."""
    return BINS if outcomes.shape[1] >= OUTCOMES else BINS // 2


@kernel
def _merge(share, i, m, work):
    """Merge outcomes of like likelihood ratio, which can only raise an error; how many are left."""
    outcomes, bins = work.outcomes, work.counts
    kinds, most = outcomes.shape[0], _bins(outcomes)
    _by_truth(share, i, m, work)
    for b in range(most):
        for c in range(kinds):
            bins[c, b] = 0.0
    for a in range(m):
        b = int((_speaks(work.truths, a) + WIDEST) * (most / (2.0 * WIDEST)))
        b = max(0, min(most - 1, b))
        for c in range(kinds):
            bins[c, b] += outcomes[c, a]
    m = 0
    for b in range(most):
        filled = 0.0
        for c in range(kinds):
            outcomes[c, m] = bins[c, b]
            filled += bins[c, b]
        if filled > 0.0:
            m += 1
    return m


@kernel
def _enumerate(problem, share, uses, plan, i, work):
    """Multiply the first column of `work.outcomes` by all a plan may perceive; how many there are.

    Percepts are cut to yes/no. `share` (N,2,C) is what the truths have of the kinds.
    """
    outcomes, counts, m = work.outcomes, work.counts, 1
    kinds, held = outcomes.shape
    most = held / _bins(outcomes) - 1.0
    for e in range(uses.shape[1]):
        if uses[plan, e] == 0 or not problem.informative[i, e]:
            continue
        seen = work.total[e]
        k = int(min(float(uses[plan, e]), problem.limit[e] - seen, most))
        if k <= 0:
            continue
        if m * (k + 1) > held:
            m = _merge(share, i, m, work)
        fresh = seen == 0.0 and k < problem.fresh.shape[3]
        for c in range(kinds):
            if fresh:
                for j in range(k + 1):
                    counts[c, j] = problem.fresh[i, e, c, k, j]
            else:
                _yes_counts(problem, i, c, e, k, work.yes[i, e], seen, counts[c])
            for a in range(m - 1, -1, -1):
                u = outcomes[c, a]
                for j in range(k, -1, -1):
                    outcomes[c, a * (k + 1) + j] = u * counts[c, j]
        m *= k + 1
    return m


@kernel
def plan_error(problem, uses, plan, i, weight, row, work):
    """Exact Bayes error of attribute i after a plan, percepts cut to yes/no.

    Cutting levels, and merging outcomes once OUTCOMES are full, can only raise the error: the
    plan's value stays a lower bound.
    """
    for c in range(weight.shape[2]):
        work.outcomes[c, 0] = weight[row, i, c]
    m, error = _enumerate(problem, problem.share, uses, plan, i, work), 0.0
    _by_truth(problem.share, i, m, work)
    for a in range(m):
        error += min(work.truths[0, a], work.truths[1, a])
    return error


@kernel
def tabulate_rules(problem, uses, attribute, work, errs):
    """Tabulate Pr(error | kind) of decision rules -> errs (G,T,C).

    Column t: the percepts uses[t] (T,E) of attribute[t] (T,), none seen before. Rule g says
    yes where the likelihood ratio outweighs prior log-odds -SPAN .. SPAN, even in g. Any rule's
    error is never below the Bayes error; where the kind is the truth, the rules next to the
    log-odds of a belief are the best ones.
    """
    size, kinds, counts = errs.shape[0], errs.shape[2], work.counts
    clear(work)
    for t in range(errs.shape[1]):
        i = attribute[t]
        for c in range(kinds):
            work.outcomes[c, 0] = 1.0
        m = _enumerate(problem, problem.kinds, uses, t, i, work)
        _by_truth(problem.kinds, i, m, work)
        for c in range(kinds):
            for g in range(size + 1):
                counts[c, g] = 0.0
        for a in range(m):
            # From this log-odds on an outcome speaks for yes.
            g = int(np.ceil((SPAN - _speaks(work.truths, a)) * ((size - 1) / (2.0 * SPAN))))
            g = min(max(g, 0), size)
            for c in range(kinds):
                counts[c, g] += work.outcomes[c, a]
        for c in range(kinds):
            yes, no = 0.0, 0.0
            for g in range(size):
                yes += counts[c, g]
                errs[g, t, c] = problem.share[i, 0, c] * yes
            for g in range(size - 1, -1, -1):
                no += counts[c, g + 1]
                errs[g, t, c] += problem.share[i, 1, c] * no


@kernel
def clear(work):
    """Forget the percepts seen."""
    for e in range(work.total.shape[0]):
        work.total[e] = 0.0
        for i in range(work.yes.shape[0]):
            work.yes[i, e] = 0.0
