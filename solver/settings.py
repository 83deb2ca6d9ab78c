"""The settings of a run: frozen dataclasses, from which panel and command line take defaults, ranges and texts."""

from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from importlib.util import find_spec
from typing import Any, ClassVar, Self

from .errors import SettingsError
from .patch_methods import METHODS

AUTOMATIC = "auto"

MOST_SPLITS = 64
"""Into how many parts an edge can be split where a surface is evaluated."""
MOST_AUTOMATIC_SPLITS = 32
"""The same where the number of parts is chosen automatically."""

MOST_POINTS = 500_000
"""Points of a cloud that are fitted if nothing else is said: as many as the largest base of automatic size needs."""


def number(default: float | int, low: float, high: float, text: str, *, soft: tuple[float, float] | None = None) -> Any:
    """Return a field that holds a number from `low` to `high`; a slider offers `soft`."""
    return field(default=default, metadata={"low": low, "high": high, "soft": soft or (low, high), "text": text})


def choice(default: str, text: str, /, **choices: str) -> Any:
    """Return a field that holds one of `choices`, each with its description."""
    return field(default=default, metadata={"choices": choices, "text": text})


def switch(default: bool, text: str) -> Any:
    """Return a field that is on or off."""
    return field(default=default, metadata={"text": text})


def check_value(name: str, value: object, metadata: Mapping[str, Any], kind: type) -> None:
    """Refuse the value of a field made by one of the functions above when it is out of range or of another kind."""
    if "choices" in metadata:
        if value not in metadata["choices"]:
            raise SettingsError(f"{name} must be one of {', '.join(metadata['choices'])}, not {value!r}.")
    elif kind is bool:
        if not isinstance(value, bool):
            raise SettingsError(f"{name} must be true or false, not {value!r}.")
    else:
        whole = kind is int
        numeric = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
        if not numeric or not metadata["low"] <= value <= metadata["high"]:
            a = "a whole number" if whole else "a number"
            raise SettingsError(f"{name} must be {a} from {metadata['low']:g} to {metadata['high']:g}, not {value!r}.")


class _Checked:
    """Base of the dataclasses of settings: every value is checked when an object is made.

    What is the same for all of them is written here: Blender waits while the decorator writes it for 33 fields, which
    takes a twentieth of the time that enabling the add-on takes.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if hasattr(value, "dtype") and getattr(value, "shape", None) == ():  # a number of NumPy's
                object.__setattr__(self, item.name, value.item())
            check_value(item.name, getattr(self, item.name), item.metadata, type(item.default))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Checked) and type(self) is type(other) and self.as_dict() == other.as_dict()

    def __hash__(self) -> int:
        return hash((type(self), *self.as_dict().values()))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self.as_dict().items())})"

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain values, in the order of the fields."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


@dataclass(frozen=True, eq=False, repr=False, match_args=False)
class Settings(_Checked):
    """Everything that determines a result.  The same settings on the same input give the same bytes.

    Each field's metadata holds its range (`low`, `high`; `soft` is what a slider offers) or its `choices`
    with their descriptions, and a `text` that says effect and cost.  Lengths are in scene units.

    Raises
    ------
    SettingsError
        When a value lies outside its range; the message names the range.

    Examples
    --------
    >>> Settings(ring=5).resolved().blending
    'partition'
    >>> Settings(domains="separate").channels
    3
    """

    method: str = choice(
        "default", "How each patch is fitted", **{method.name: method.text for method in METHODS.values()}
    )
    ring: int = number(7, 1, 50, "Patch radius in edge rings. Larger: fewer coefficients, less detail", soft=(2, 12))
    degree: int = number(
        14, 0, 30, "Highest total degree of a patch's polynomials. Cost grows with its square", soft=(2, 20)
    )
    sparsity: int = number(
        15, 1, 496, "Most polynomials for each coordinate of a patch. Higher: closer fit, more time", soft=(3, 60)
    )
    automatic_sparsity: bool = switch(
        False,
        "Choose the number of polynomials, up to the sparsity, by cross-validation. Takes up to four times as long",
    )
    domains: str = choice(
        "common",
        "Whether x, y and z share one optimised domain",
        common="One domain for the three coordinates",
        separate="A domain for each coordinate: more accurate, slower, three times the storage",
    )
    initial_domain: str = choice(
        "lscm",
        "Parameterisation from which the optimisation starts",
        lscm="Least squares conformal map with a free border",
        harmonic="Discrete conformal (harmonic) map to a circle",
        tutte="Tutte's embedding in a circle",
    )
    iterations: int = number(
        15, 0, 200, "Most steps of the domain optimisation. Settled patches stop sooner", soft=(4, 40)
    )
    sweeps: int = number(
        1, 0, 20, "Gauss-Seidel passes that make patches agree. Each costs almost half of the solve", soft=(0, 5)
    )
    blending: str = choice(
        AUTOMATIC,
        "Weights with which overlapping patches are blended",
        auto="Partition of unity for the default method, uniform for the paper's methods",
        partition="Partition of unity: fades to zero at a patch's rim, so the surface has no seams",
        uniform="The paper's plain average; jumps where a patch ends",
    )
    basis: str = choice(
        AUTOMATIC,
        "Polynomial basis of the dictionary",
        auto="Legendre for the default method, monomials for the paper's methods",
        legendre="Products of Legendre polynomials",
        monomial="Monomials, as in the paper",
    )
    pursuit: str = choice(
        AUTOMATIC,
        "How the polynomials of a patch are selected",
        auto="Orthogonal least squares for the default method, matching pursuit for the paper's methods",
        ols="Orthogonal least squares with one replacement pass",
        omp="Orthogonal matching pursuit",
        sklearn="Orthogonal matching pursuit by scikit-learn, one signal at a time: the slow reference for omp",
    )
    beta1: float = number(0.2, 0.0, 1e6, "Weight that holds the domain near its start (eq. 4)", soft=(0.0, 1.0))
    beta2: float = number(0.1, 0.0, 1e6, "Weight that keeps the domain's triangles rigid (eq. 4)", soft=(0.0, 1.0))
    rho: float = number(0.1, 1e-6, 1e6, "Penalty factor of the paper's iteration (section 3.3)", soft=(0.01, 100.0))
    tau: float = number(1.0, 0.0, 2.0, "Multiplier step of the paper's iteration (section 3.3)", soft=(0.0, 1.0))
    initial_fit: str = choice(
        "zero",
        "Start of the auxiliary variable f of the paper's iteration",
        zero="f = 0, as printed; the first iteration then selects nothing",
        data="f = b, the data",
    )
    regularisation: str = choice(
        "printed",
        "What beta1 and beta2 multiply in the paper's iteration (eq. 4)",
        printed="Sums over a patch's vertices and triangles, as printed",
        vertex="The same sums divided by the patch's number of vertices: a far freer domain",
    )
    rigidity_reference: str = choice(
        "initial",
        "Domain from which the rigidity of the paper's iteration is measured",
        initial="The initial domain: the whole transformation is kept rigid",
        previous="The previous iteration's domain: each step is kept rigid, their sum may be large",
    )
    observations: str = choice(
        AUTOMATIC,
        "Where a patch is compared with the surface",
        auto="At vertices and triangle centres for the default method, at vertices for the paper's methods",
        centroids="At vertices and triangle centres, so that nothing oscillates in between",
        vertices="At vertices only, as in the paper. Faster; may oscillate between them",
    )
    keep_iterations: bool = switch(
        False, "Keep the surface after each iteration, as shape keys of the result. Takes memory"
    )
    tolerance: float = number(
        0.0, 0.0, 1e12, "Largest allowed surface error in scene units; patches are refined until it is met. 0: off"
    )
    adaptive: bool = switch(
        True, "Split patches whose initial domain is badly squeezed into smaller rings before solving"
    )
    creases: str = choice(
        AUTOMATIC,
        "Where the surface is cut to have sharp creases; the cut is closed exactly",
        auto="Where the fitted domains show creases. None with the paper's methods or uniform blending",
        marked="Along the edges that the mesh marks as sharp, and no others",
        off="Nowhere: creases become narrow fillets",
    )
    mark_creases: bool = switch(False, "Mark the edges that the optimisation treats as creases as sharp on the result")
    denoise: str = choice(
        "off",
        "Whether noise is removed first; creases are kept, and a mesh without noise stays as it is",
        off="Approximate the mesh as it is",
        only="Only remove the noise: the denoised mesh is the result",
        first="Remove the noise, then approximate the denoised mesh",
    )
    denoise_strength: float = number(
        1.0, 0.0, 10.0, "How much noise is removed, as a multiple of what is found. 0: none", soft=(0.0, 3.0)
    )
    noise_level: float = number(
        0.0, 0.0, 1e12, "Standard deviation of the noise in scene units. 0: estimated from the mesh"
    )
    merge_vertices: bool = switch(
        True, "Hold vertices on open borders together that lie at one place. The result keeps all of them"
    )
    merge_distance: float = number(
        0.0, 0.0, 1e12, "Distance in scene units within which they are held together. 0: a millionth of the size"
    )
    pin_boundary: bool = switch(False, "Keep the vertices of open borders where they are")
    solver: str = choice(
        "native",
        "What fits the patches",
        native="The compiled kernel, several times as fast. NumPy where it cannot be used; the report says why",
        numpy="NumPy, the reference",
    )
    workers: int = number(
        0,
        0,
        256,
        "Threads or processes that solve patches. 0: one for each physical core; 1: all in this process",
        soft=(0, 32),
    )

    @property
    def channels(self) -> int:
        """Number of domains that a patch has: one for x, y and z together, or one for each."""
        return 3 if self.domains == "separate" else 1

    def resolved(self) -> Self:
        """Return the settings with every automatic choice replaced by what the method uses.

        Raises
        ------
        SettingsError
            When the pursuit of scikit-learn is asked for and scikit-learn is not installed, or marked creases with what
            cannot have them.
        """
        defaults: Mapping[str, Any] = METHODS[self.method].defaults
        changes = {name: value for name, value in defaults.items() if getattr(self, name) == AUTOMATIC}
        found = {**self.as_dict(), **changes}
        if self.method != "default" or found["blending"] != "partition":
            if found["creases"] == "marked":
                raise SettingsError("Marked creases need the default method and blending by a partition of unity.")
            changes["creases"] = "off"
        if found["pursuit"] == "sklearn" and find_spec("sklearn") is None:
            raise SettingsError("The pursuit 'sklearn' needs scikit-learn, which is not installed.")
        return replace(self, **changes)

    @classmethod
    def given(cls, settings: Self | None) -> Self:
        """Return the settings, or the defaults where there are none.

        Raises
        ------
        SettingsError
            When they are something else, a dictionary for example.
        """
        if settings is not None and not isinstance(settings, Settings):
            raise SettingsError(f"The settings must be made by Settings(...), not {settings!r}.")
        return settings or cls()

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Build settings from plain values; unknown names are refused.

        Raises
        ------
        SettingsError
            On an unknown name or a value outside of its range.
        """
        known = {item.name for item in fields(cls)}
        unknown = sorted(set(values) - known)
        if unknown:
            raise SettingsError(f"There is no setting named {unknown[0]!r}.")
        return cls(**values)


@dataclass(frozen=True, eq=False, repr=False, match_args=False)
class CloudSettings(_Checked):
    """How points become observations over a base mesh; metadata as in `Settings`.

    Raises
    ------
    SettingsError
        When a value lies outside its range; the message names the range.

    Examples
    --------
    >>> from sparse_surface.solver import CloudSettings
    >>> CloudSettings(robust="tukey").robust
    'tukey'
    """

    ring: int = number(
        0,
        0,
        20,
        "Patch radius in edges of the base. 1: the faces around a vertex; 2: all faces that touch these. "
        "0: 1 for clean points, larger where the points are noisy",
        soft=(0, 4),
    )
    robust: str = choice(
        "none",
        "How points far from the surface count",
        none="All points count alike",
        huber="Farther points count less: for noise with heavy tails",
        tukey="Points beyond a few noise levels do not count: for outliers",
    )
    strays: str = choice(
        "drop",
        "What becomes of stray points: isolated, and off the surface that the points around them show",
        drop="They are left out before the base is made",
        keep="They count like all others",
    )
    noise: float = number(
        0.0, 0.0, 1e12, "Standard deviation of the points' noise in scene units. 0: estimated from the points"
    )
    creases: bool = switch(
        True, "Estimate where smooth sides of the cloud meet and observe the surface there too: sharper creases"
    )
    fit_base: bool = switch(
        True, "Move the base to the points, and its vertices onto nearby creases, before projecting the points"
    )
    corrections: int = number(
        2,
        0,
        20,
        "How often the points are projected again, onto the surface itself, and the patches refitted. "
        "Higher: closer fit, more time",
        soft=(0, 5),
    )
    close_holes: float = number(
        0.0,
        0.0,
        1e12,
        "Close holes of the points that are up to this wide, in scene units, where the base is made. "
        "0: only gaps of a few spacings",
    )
    trim_distance: float = number(
        0.0, 0.0, 1e12, "Cut the surface off where it is farther than this from every point, in scene units. 0: off"
    )
    trim_density: float = number(
        0.0,
        0.0,
        1.0,
        "Cut the surface off where points are sparser than this share of their usual density. Borders stay below 0.25. "
        "0: off",
        soft=(0.0, 0.25),
    )


PRESETS: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {"method": "paper", "sweeps": 2},
    "fast": {"iterations": 6, "sweeps": 0},
    "precise": {"domains": "separate", "ring": 5, "sparsity": 18, "beta1": 0.002, "beta2": 0.03},
    "denoise": {"denoise": "only"},
}
"""Changes of the defaults by name, the same in the panel and on the command line."""
