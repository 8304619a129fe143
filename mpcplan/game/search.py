"""The best sequences of actions, found exactly without looking at all of them.

Wanted are the sequences gamma of Gamma with the greatest R(gamma) = own(gamma) + pairs(gamma),
where pairs is a sum over gamma's actions of terms <= 0, each of which depends on the actions up to
its own and is dear to compute. The own parts of all sequences are known. So, for a prefix p,

    bound(p) = max over gamma that begin with p of own(gamma)  +  pairs of p  >=  R(gamma).

A first look takes, for each first action, the sequence of the best own part, and computes it
whole; the best of these rewards is the bar. Then follow, action by action, the prefixes with bounds
not below the bar, until few sequences are left. Sums are formed in the same order everywhere, and
rounding is monotone, so that a bound is one in floating-point numbers too: what is found is exactly
what enumeration finds, where of equal sequences the one computed last, of the greatest index, is
the best.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from mpcplan.game.actions import ACTIONS
from mpcplan.game.tree import begins, rows_of
from mpcplan.trajectory import Array

FEW = 24  # sequences that are no longer worth sorting out: they are computed whole
AHEAD = 14  # the most promising nodes of a layer, each of which is looked below

Search = Generator[Array, Array, "Best"]
"""A search under way: it asks for the pairwise terms of actions, of rows (n, k) of the tree's
arrays, is sent them, (n, k), and returns the best sequences. So that many searches can be answered
at once; see :func:`together`."""


@dataclass(frozen=True, eq=False)
class Best:
    """The best sequences, best first.

    Attributes:
        index: (n,) in Gamma.
        reward: (n,) of them.
        evaluated: actions whose pairwise terms were computed.
        pruned: sequences that were left out by their bound.
    """

    index: Array
    reward: Array
    evaluated: int
    pruned: int


@dataclass(frozen=True, eq=False)
class Own:
    """A player's own rewards.

    Attributes:
        total: (14^T,) of whole sequences.
        best: for t = 1, ..., T (14^t,) the best total below each node.
        leaf: (14,) the sequence with the best total for each first action, the last of equals.
    """

    total: Array
    best: tuple[Array, ...]
    leaf: Array


def own_of(rewards: Array, depth: int) -> Own:
    """From the own rewards (N,) of the last actions of all nodes, layer by layer."""
    total = np.zeros(1)
    for layer in range(depth):
        total = (
            np.repeat(total, ACTIONS)
            + rewards[begins(depth + 1)[layer] : begins(depth + 1)[layer + 1]]
        )
    best = [total]
    for _ in range(1, depth):
        best.insert(0, best[0].reshape(-1, ACTIONS).max(axis=1))
    by_first = total.reshape(ACTIONS, -1)
    last = by_first.shape[1] - 1 - by_first[:, ::-1].argmax(axis=1)
    return Own(total, tuple(best), last + by_first.shape[1] * np.arange(ACTIONS))


def search(own: Own, keep: int = 1, likely: Array | None = None) -> Search:
    """Searches the ``keep`` best sequences.

    ``likely`` (n,) are sequences that may be good, for the first look.
    """
    count, depth = len(own.total), len(own.best)
    some = own.leaf if likely is None else np.union1d(own.leaf, likely)
    terms = yield rows_of(some, depth)
    evaluated = terms.size
    bar = _nth(own.total[some] + _sum(terms), keep)
    nodes, known = np.arange(ACTIONS), terms[np.searchsorted(some, own.leaf), 0]
    for t in range(1, depth):
        bound = own.total.reshape(ACTIONS**t, -1)[nodes] + known[:, None]
        row, below = np.nonzero(bound >= bar)
        if len(row) <= FEW:
            leaves = bound.shape[1] * nodes[row] + below
            terms = yield rows_of(leaves, depth)
            rewards = own.total[leaves] + _sum(terms)
            return _ranked(leaves, rewards, keep, evaluated + terms.size, count - len(leaves))
        nodes = (ACTIONS * nodes[:, None] + np.arange(ACTIONS)).ravel()
        known = np.repeat(known, ACTIONS)
        kept = own.best[t][nodes] + known >= bar
        nodes, known = nodes[kept], known[kept]
        known = known + (yield nodes[:, None] + begins(depth)[t])[:, 0]
        evaluated += len(nodes)
        if t < depth - 1:
            some = np.argsort(-(own.best[t][nodes] + known), kind="stable")[: max(AHEAD, keep)]
            leaves = _best_below(own, t, nodes[some])
            terms = yield rows_of(leaves, depth)[:, t + 1 :]
            evaluated += terms.size
            further = np.column_stack([known[some], terms])
            bar = max(bar, _nth(own.total[leaves] + _sum(further), keep))
    return _ranked(nodes, own.total[nodes] + known, keep, evaluated, count - len(nodes))


def enumerate_all(own: Own, keep: int = 1) -> Search:
    """The same by looking at all sequences: slow, for comparison."""
    everything = np.arange(len(own.total))
    terms = yield rows_of(everything, len(own.best))
    return _ranked(everything, own.total + _sum(terms), keep, terms.size)


def without_others(own: Own, keep: int = 1) -> Best:
    """The best sequences where there is nobody else."""
    return _ranked(np.arange(len(own.total)), own.total, keep, 0)


def together(searches: Sequence[Search], terms: Callable[[Array, Array], Array]) -> list[Best]:
    """The results of searches, in which all that they ask for at a time is answered at once.

    Args:
        searches: not yet begun.
        terms: the pairwise terms (r,) of actions: of searches (r,), of rows (r,) of their trees.
    """
    found: list[Best | None] = [None] * len(searches)
    asked = {i: next(one) for i, one in enumerate(searches)}
    while asked:
        who = np.repeat([*asked], [rows.size for rows in asked.values()])
        answers = terms(who, np.concatenate([rows.ravel() for rows in asked.values()]))
        ends = np.cumsum([rows.size for rows in asked.values()])
        parts = np.split(answers, ends[:-1])
        following = {}
        for (i, rows), part in zip(asked.items(), parts, strict=True):
            try:
                following[i] = searches[i].send(part.reshape(rows.shape))
            except StopIteration as ended:
                found[i] = ended.value
        asked = following
    return [one for one in found if one is not None]


def _best_below(own: Own, t: int, nodes: Array) -> Array:
    """For nodes (n,) of a layer the sequences below them whose own parts are the best."""
    total = own.total.reshape(len(own.best[t]), -1)
    return nodes * total.shape[1] + total[nodes].argmax(axis=1)


def _sum(terms: Array) -> Array:
    """(n,) sums of terms (n, T), the first ones first."""
    found = terms[:, 0]
    for column in range(1, terms.shape[1]):
        found = found + terms[:, column]
    return found


def _nth(rewards: Array, n: int) -> float:
    """The n-th greatest reward; minus infinity where there are fewer."""
    return float(np.sort(rewards)[-n]) if len(rewards) >= n else -np.inf


def _ranked(index: Array, reward: Array, keep: int, evaluated: int, pruned: int = 0) -> Best:
    """The best of sequences (n,) with rewards (n,): of equal ones the greatest index first."""
    if len(reward) > keep:
        some = np.flatnonzero(reward >= _nth(reward, keep))
        index, reward = index[some], reward[some]
    order = np.lexsort((-index, -reward))[:keep]
    return Best(index[order], reward[order], evaluated, pruned)
