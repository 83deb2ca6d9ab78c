"""The colours of error values: the map viridis, and two colours for inside and outside of a tolerance.

viridis (S. van der Walt and N. Smith, 2015, public domain; the default of Matplotlib) runs from dark violet over teal
to yellow.  Equal steps of value look equal; its lightness rises throughout, so that it reads the same in grey and for
colour-blind readers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Colours = NDArray[np.float32]

# sRGB, 16 bits a channel, from small values to large.
_VIRIDIS = bytes.fromhex(
    "445a013f545444bd027555de451b03be57644574051b58e645c8068b5a64461808105bdd466309aa5d5246a90b4e5ec346ea0ce3602e"
    "47270e6b6195475f0fe962f74791115e645447bf12cb65ac47e8143366ff480d1596684c482c16f469944846184f6ad6485c19a66c12"
    "486d1afb6d4948781c4d6e7a487f1d9d6fa548811eeb70ca487f203771e8487721827301486b22cc7413485a2414751f4844255a7625"
    "482926a07724480a27e5781d47e72928790f47bf2a6b79fb47922bac7ae147612ced7bbf472c2e2c7c9846f22f6b7d6946b430a87e35"
    "467331e57efa462d33217fb845e3345b8070459635958122454536cd81ce44f1380482734499393a8312443e3a6f83ac43e03ba3843f"
    "437f3cd584cd431b3e06855542b53f3685d8424b4064865541e0419186cc417242bd873f410243e787ac409045108815401c46388879"
    "3fa6475e88d83f2f488289333eb649a589893e3c4ac689dc3dc14be68a2a3d464d058a743cc94e218abb3c4b4f3d8afe3bcd50578b3d"
    "3b4f516f8b7a3ad052868bb33a51539b8be939d254af8c1c395355c28c4d38d456d38c7a385557e38ca637d758f18ccf375959fe8cf5"
    "36dc5b098d1a365f5c148d3c35e35d1d8d5d35685e258d7c34ee5f2b8d99347460318db433fc61358dcd338462388de6330e633a8dfc"
    "3298643b8e123224653b8e2631b0663a8e39313e67388e4b30cd68358e5b305d69318e6b2fee6a2c8e792f806b278e872f146c218e93"
    "2ea86d1a8e9f2e3e6e128ea92dd46f0a8eb32d6b70018ebc2d0470f88ec42c9d71ee8ecb2c3772e48ed12bd273d98ed62b6e74cd8eda"
    "2b0a75c18ede2aa776b58ee02a4577a98ee229e3789c8ee22982798f8ee229217a818ee028c17b738edd28617c668ed928017d588ed4"
    "27a27e498ece27437f3b8ec626e4802c8ebd2685811e8eb32627820f8ea725c983008e9a256c83f28e8b250f84e38e7b24b285d48e69"
    "245686c58e5523fa87b68e3f239f88a78e27234589998e0e22eb8a8a8df222948b7b8dd4223d8c6c8db421e88d5d8d9221948e4f8d6d"
    "21438f408d4620f490328d1d20a891238cf1205f92148cc2201a93068c901fd893f78c5c1f9b94e98c251f6395da8beb1f3096cc8bad"
    "1f0397bd8b6d1edd98af8b2a1ebe99a08ae31ea79a918a991e989b828a4b1e929c7389fa1e969d6489a61ea49e55894e1ebe9f4588f2"
    "1ee2a03688921f13a126882f1f50a21687c81f9aa305875c1ff1a3f586ed2057a4e4867a20caa5d28603214ca6c0858821dca7ae8508"
    "227ba89c84842329a98983fc23e5aa75836f24afab6182de2588ac4c82492670ad3781af2765ae2181112869af0b806e297aaff37fc6"
    "2a98b0db7f1a2bc3b1c27e692cfbb2a97db42e3fb38e7cf92f8fb4737c3a30ebb5577b763252b63a7aae33c4b71b79e03541b7fc790e"
    "36c8b8dc7836385ab9ba775a39f5ba9876793b9abb7475933d47bc4f74a83efebd2873b740bebe0172c24286bed871c84456bfad70c9"
    "462ec0826fc5480fc1546ebb49f6c2256dad4be6c2f56c994ddcc3c36b814fdac48f6a6351dfc55a694153eac623681955fcc6ea66ec"
    "5815c7af65ba5a34c87364835c59c93463475e84c9f4620660b6cab160c062edcb6d5f75652acc275e25676cccde5cd069b4cd935b76"
    "6c02ce465a166e54cef758b270accfa657497309d05255db756bd0fc546977d2d1a452f17a3dd24951757cadd2ec4ff47f22d38d4e6e"
    "819ad42a4ce48418d4c64b568699d55f49c2891ed5f5482b8ba7d689468f8e34d71a44ef90c4d7a9434c9358d83541a495eed8be3ff9"
    "9888d9453e4b9b25d9c93c999dc5da4a3ae4a067dac9392da30bdb453774a5b2dbbf35b9a85bdc3633fdab05dcab3240adb1dd1d3083"
    "b05edd8d2ec7b30cddfb2d0cb5bbde662b54b86bdece29a0bb1bdf3527f1bdcbdf992649c07bdffc24aac32ae05c2316c5d9e0bb2190"
    "c887e118201acb33e1731eb9cddee1cd1d6ed087e2251c40d32ee27c1b31d5d3e2d21a47d876e3271986db16e37a18f3ddb2e3cd1890"
    "e04ce4201862e2e2e472186ae574e4c318a9e803e514191fea8ee56519c8ed14e5b71aa4ef96e6081baef214e6591ce3f48ee6ab1e3e"
    "f702e6fe1fbaf972e7512156fbdee7a4230cfe45e7f924d9"
)
STEPS = 256

BARS = 40
"""Of a histogram over the range."""

# RdBu of ColorBrewer (C. Brewer and M. Harrower, 2003), from blue to red, safe for colour-blind readers; sRGB.
_BLUE_TO_RED = bytes.fromhex("053061 2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b 67001f")

# Blue and vermilion differ with every kind of colour blindness (M. Okabe and K. Ito, 2008); sRGB.
INSIDE = (0.0, 0.447, 0.698)
OUTSIDE = (0.835, 0.369, 0.0)
# Green, between them, marks what lies within a tolerance on both sides.
WITHIN = (0.0, 0.620, 0.451)


@dataclass(frozen=True)
class ColourScale:
    """Which value gets which colour.

    Attributes
    ----------
    low, high
        Values at the ends of the map; values beyond take the end's colour.  With a negative `low` values have signs,
        and the map runs from blue over white to red.
    tolerance
        Where positive, there are two colours only, `INSIDE` up to it and `OUTSIDE` above; for values with signs three,
        `INSIDE` below, `WITHIN` and `OUTSIDE` above.
    """

    low: float
    high: float
    tolerance: float = 0.0

    @property
    def signed(self) -> bool:
        """Whether values have signs."""
        return self.low < 0.0

    @property
    def bands(self) -> tuple[tuple[float, float, float], ...]:
        """The colours in sRGB, from small values to large, where there is a tolerance."""
        return (INSIDE, WITHIN, OUTSIDE) if self.signed else (INSIDE, OUTSIDE)

    def shares(self, values: NDArray[np.floating], weights: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return which share of the weights has values in each part of the range; with a tolerance, in each band."""
        if self.tolerance > 0.0:
            parts, count = self.band(values), len(self.bands)
        else:
            count = BARS
            share = (np.asarray(values, dtype=np.float64) - self.low) / max(self.high - self.low, 1e-300)
            parts = np.clip(share * count, 0, count - 1).astype(np.intp)
        sums = np.bincount(parts, weights=weights, minlength=count)
        return np.asarray(sums / max(sums.sum(), 1e-300))

    def band(self, values: NDArray[np.floating]) -> NDArray[np.intp]:
        """Return the number of the band, from small values to large, in which each value lies."""
        band = (values > self.tolerance).astype(np.intp)
        return band + (values >= -self.tolerance) if self.signed else band

    def colours(self, values: NDArray[np.floating]) -> Colours:
        """Return linear RGBA (n, 4) of the values (n,)."""
        rgba = np.ones((len(values), 4), dtype=np.float32)
        if self.tolerance > 0.0:
            rgba[:, :3] = srgb_to_linear(np.array(self.bands))[self.band(values)]
        else:
            share = (np.asarray(values, dtype=np.float64) - self.low) / max(self.high - self.low, 1e-300)
            rgba[:, :3] = ramp(self.signed)[np.rint(np.clip(share, 0.0, 1.0) * (STEPS - 1)).astype(np.intp)]
        return rgba


@cache
def ramp(signed: bool = False) -> Colours:
    """Return the map as linear RGB, (STEPS, 3), from small values to large."""
    if signed:
        knots = np.frombuffer(_BLUE_TO_RED, dtype=np.uint8).reshape(-1, 3) / 255.0
        at = np.linspace(0.0, len(knots) - 1.0, STEPS)
        mixed = [np.interp(at, np.arange(len(knots)), knots[:, channel]) for channel in range(3)]
        return srgb_to_linear(np.stack(mixed, axis=1)).astype(np.float32)
    srgb = np.frombuffer(_VIRIDIS, dtype=">u2").reshape(STEPS, 3) / 65535.0
    return srgb_to_linear(srgb).astype(np.float32)


def srgb_to_linear(colours: NDArray[np.floating]) -> NDArray[np.float64]:
    """Undo the transfer curve of sRGB (IEC 61966-2-1)."""
    colours = np.asarray(colours, dtype=np.float64)
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(colours: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply the transfer curve of sRGB (IEC 61966-2-1)."""
    colours = np.asarray(colours, dtype=np.float64)
    return np.where(colours <= 0.0031308, colours * 12.92, 1.055 * np.clip(colours, 0.0, None) ** (1.0 / 2.4) - 0.055)
