"""
Payload and drift together, first layer: what turns with gravity, apart from what warms up.

A day's raw wrench is r(t) = c + o(T) + a_k f(t) + contact + noise, a_k (6, 3) of payload state k.
All of o and c is taken out by parabolas over BLOCK_S, so that neither temperatures nor tares have
to be understood before payloads are, and what is left are contrasts between poses, which only
payloads and contacts make. Contacts are outliers of all six axes of a cell at once, and lose their
weight by 1 / (1 + (e / c σ)²)², with c falling to 4. States are assigned to cells by turns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrist_ft_comp.model.signals import BoolArray, FloatArray, IntArray

BLOCK_S, POWERS = 300, 3
#: Cells that turn faster are left out, rad/s: ω×(ω×c) of the payload is not seen.
FASTEST = 0.5
TUNING, START = 4.0, 40.0
ROUNDS = 25
#: This share of cells is taken to be free of contact; norm of six normal variables there.
QUIETER, QUIETER_NORM = 0.3, 0.80
GRAVITY = 9.807


@dataclass(frozen=True, eq=False)
class Cells:
    """
    All days in blocks of B cells, filled up with cells of no weight.

    Attributes
    ----------
    wrench, force : ndarrays, shapes (n, B, 6) and (n, B, 3)
        Raw wrench, N and N m, and specific force, m/s².
    usable : ndarray, shape (n, B)
        Whether they are known and the sensor does not turn fast.

    """

    wrench: FloatArray
    force: FloatArray
    usable: BoolArray

    def part(self, blocks: BoolArray) -> 'Cells':
        """Choose blocks."""
        return replace(
            self,
            wrench=self.wrench[blocks],
            force=self.force[blocks],
            usable=self.usable[blocks],
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """
    Payload states of cells.

    Attributes
    ----------
    gains : ndarray, shape (K, 3, 6)
        Of specific force, kg and kg m.
    states : ndarray, shape (n, B)
        Which one holds in a cell.
    weights, levels : ndarrays, shapes (n, B) and (n, B, 6)
        Of the cells, and the parabolas.
    noise : ndarray, shape (6,)
        σ of a cell that is not in contact, N and N m.

    """

    gains: FloatArray
    states: IntArray
    weights: FloatArray
    levels: FloatArray
    noise: FloatArray


def parabolas(cells: int) -> FloatArray:
    """Draw Legendre polynomials over a block, (B, P)."""
    share = (np.arange(cells) + 0.5) / cells * 2 - 1
    return np.asarray(np.polynomial.legendre.legvander(share, POWERS - 1), dtype=float)


def solve(
    cells: Cells, states: IntArray, weights: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Fit gains (K, 3, 6) to weighted cells, parabolas eliminated; and normal matrix (3K, 3K)."""
    size = 3 * count
    shape = cells.wrench.shape[:2]
    chosen = (states[..., None] == np.arange(count))[..., None] * cells.force[:, :, None]
    z = np.concatenate((chosen.reshape(*shape, size), cells.wrench), axis=2)
    normal = eliminated(z, weights)
    gram = normal[:size, :size]
    ridge = 1e-9 * np.trace(gram) / size * np.eye(size)
    return np.linalg.solve(gram + ridge, normal[:size, size:]).reshape(count, 3, 6), gram


def eliminated(z: FloatArray, weights: FloatArray) -> FloatArray:
    """Sum products of columns over blocks, parabolas eliminated in each."""
    phi = parabolas(z.shape[1])
    weighted = weights[..., None] * z
    crossed = phi.T @ weighted
    inner = np.einsum('bp,nb,bq->npq', phi, weights, phi) + 1e-9 * np.eye(POWERS)
    own = np.einsum('nbi,nbj->ij', weighted, z, optimize=True)
    taken = np.einsum('npi,npj->ij', crossed, np.linalg.solve(inner, crossed))
    return np.asarray(own - taken)


def leveled(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Fit parabolas to weighted values (n, B, 6), and draw them."""
    phi = parabolas(values.shape[1])
    inner = np.einsum('bp,nb,bq->npq', phi, weights, phi) + 1e-6 * np.eye(POWERS)
    return np.asarray(phi @ np.linalg.solve(inner, phi.T @ (weights[..., None] * values)))


def errors(cells: Cells, gains: FloatArray, levels: FloatArray, noise: FloatArray) -> FloatArray:
    """Norms over six axes of what each state leaves in each cell, (K, n, B)."""
    rest = (cells.wrench - levels) / noise
    left = [rest - cells.force @ (a / noise) for a in gains]
    return np.array([np.sqrt(np.einsum('nbi,nbi->nb', e, e) / 6) for e in left])


def rescaled(cells: Cells, fit: Fit) -> Fit:
    """Estimate the noise of a cell from those that count, and from the quieter ones of all."""
    rest = cells.wrench - fit.levels - pulled(cells, fit)
    square = np.einsum('nb,nbi->i', fit.weights, rest**2) / fit.weights.sum()
    norm = np.sqrt(np.sum(rest**2 / square, axis=2) / 6)[cells.usable]
    return replace(fit, noise=np.sqrt(square) * np.quantile(norm, QUIETER) / QUIETER_NORM)


def redescend(error: FloatArray, usable: BoolArray, width: float) -> FloatArray:
    """Weigh cells by their error, (n, B)."""
    return np.asarray(usable / (1 + (error / width) ** 2) ** 2)


def loss(error: FloatArray, usable: BoolArray, width: float) -> FloatArray:
    """Sum over the cells of a block what is not explained: 1 each far out, (n,)."""
    square = (error / width) ** 2
    return np.asarray((usable * square / (1 + square)).sum(axis=1))


def assign(cells: Cells, fit: Fit, width: float, starts: Sequence[IntArray], turns: int) -> Fit:
    """Give every cell the state that explains it best, in each block from the best start."""
    best = fit
    cost: FloatArray = np.full(len(cells.wrench), np.inf)
    for states in starts:
        fresh = states is not fit.states
        found = replace(
            fit, states=states, weights=cells.usable.astype(float) if fresh else fit.weights
        )
        for _ in range(turns):
            values = cells.wrench - pulled(cells, found)
            levels = leveled(values, found.weights)
            each = errors(cells, fit.gains, levels, fit.noise)
            weights = redescend(each.min(axis=0), cells.usable, width)
            found = replace(found, states=each.argmin(axis=0), weights=weights, levels=levels)
        lost = loss(each.min(axis=0), cells.usable, width)
        better = lost < cost - 1.0
        cost = np.where(better, lost, cost)
        pick = better[:, None]
        best = replace(
            best,
            states=np.where(pick, found.states, best.states),
            weights=np.where(pick, found.weights, best.weights),
            levels=np.where(pick[..., None], found.levels, best.levels),
        )
    return best


def pulled(cells: Cells, fit: Fit) -> FloatArray:
    """Weigh every cell's payload, (n, B, 6)."""
    each = [cells.force @ gains for gains in fit.gains]
    return np.choose(fit.states[..., None], each) if len(each) > 1 else each[0]


def everywhere(cells: Cells, count: int) -> list[IntArray]:
    """Start with each state everywhere."""
    return [np.full(cells.usable.shape, k) for k in range(count)]


def explained(cells: Cells, gains: FloatArray, noise: FloatArray) -> Fit:
    """Assign cells that gains were not fitted to."""
    start = Fit(
        gains,
        np.zeros(cells.usable.shape, dtype=np.int64),
        cells.usable.astype(float),
        np.zeros_like(cells.wrench),
        noise,
    )
    return assign(cells, start, TUNING, everywhere(cells, len(gains)), 8)


def fit_states(cells: Cells, states: IntArray, count: int, *, rounds: int = ROUNDS) -> Fit:
    """Fit so many states by turns from a start, contacts losing their weight on the way."""
    weights = cells.usable.astype(float)
    gains, _ = solve(cells, states, weights, count)
    fit = Fit(gains, states, weights, np.zeros_like(cells.wrench), np.ones(6))
    fit = assign(cells, fit, 1e9, [states], 1)
    for step in range(rounds):
        fit = rescaled(cells, fit)
        width = max(TUNING, START * 0.8**step)
        fit = assign(cells, fit, width, [fit.states], 2)
        if count > 1 and step % 5 == 4:
            fit = assign(cells, fit, width, [fit.states, *everywhere(cells, count)], 8)
        gains, _ = solve(cells, fit.states, fit.weights, count)
        fit = replace(fit, gains=gains)
    return fit


def split(cells: Cells, fit: Fit) -> list[IntArray]:
    """Start one state more: cut each in two where cells weigh more or less than it says."""
    starts = []
    rest = cells.wrench - fit.levels
    for k, gains in enumerate(fit.gains):
        pull = cells.force @ gains
        excess = np.sum((rest - pull) * pull, axis=2) / np.maximum(np.sum(pull**2, axis=2), 1e-9)
        mine = cells.usable & (fit.states == k)
        for share in (0.3, 0.5, 0.7):
            if mine.sum() > 100:
                limit = np.quantile(excess[mine], share)
                starts.append(np.where(mine & (excess > limit), len(fit.gains), fit.states))
    return starts


def unexplained(cells: Cells, fit: Fit, noise: FloatArray) -> float:
    """Share of usable cells that the states do not explain, the gains left as they are."""
    fit = explained(cells, fit.gains, noise)
    each = errors(cells, fit.gains, fit.levels, noise).min(axis=0)
    return float(loss(each, cells.usable, TUNING).sum() / cells.usable.sum())


def one_more(cells: Cells, fit: Fit) -> Fit:
    """Fit one state more, from the split that explains most."""
    count = len(fit.gains) + 1
    tried = [fit_states(cells, start, count, rounds=10) for start in split(cells, fit)]
    noise = np.min([each.noise for each in tried], axis=0)
    best = min(tried, key=lambda each: unexplained(cells, each, noise))
    return fit_states(cells, best.states, count)


def information(cells: Cells, fit: Fit) -> tuple[FloatArray, FloatArray]:
    """
    Tell how well gains are known: normal matrix (3K, 3K), and what to divide it by per axis (6,).

    The errors of a block are taken to depend on one another, those of different blocks not.
    """
    count = len(fit.gains)
    chosen = (fit.states[..., None] == np.arange(count))[..., None] * cells.force[:, :, None]
    z = chosen.reshape(*fit.states.shape, 3 * count)
    rest = cells.wrench - pulled(cells, fit)
    z = z - leveled(z, fit.weights)
    rest = rest - leveled(rest, fit.weights)
    weighted = fit.weights[..., None] * z
    normal = np.einsum('nbi,nbj->ij', weighted, z, optimize=True)
    scores = np.einsum('nbi,nba->nia', weighted, rest, optimize=True)
    spread = np.einsum('nia,nja->aij', scores, scores)
    inverse = np.linalg.pinv(normal, rcond=1e-6, hermitian=True)
    rank = max(1, np.linalg.matrix_rank(normal, tol=1e-6 * np.trace(normal), hermitian=True))
    return normal, np.einsum('ij,aji->a', inverse, spread) / rank
