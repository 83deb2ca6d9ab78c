"""Reports in words, for every reader: one line, or rows of figures.  Needs neither NumPy nor Blender.

The words are English unless `speak` was given a translator, as the add-on does with Blender's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Report = dict[str, Any]

Length = Callable[[float], Any]
"""How a length is shown; without a scene, whose units say it, as a plain number in Blender units."""

FAR_FROM_POINTS = 5.0
"""A surface farther than this from the points, in their spacings, is worth a warning."""


_in_words: list[Callable[[str], str]] = [str]


def speak(translator: Callable[[str], str]) -> None:
    """Use this translator from now on; `str` for English."""
    _in_words[0] = translator


def translate(text: str) -> str:
    """Return a sentence, with its places for values, in the reader's language."""
    return _in_words[0](text)


def plain(length: float) -> str:
    """Return a length as a number of three digits."""
    return f"{length:.3g}"


def one_line(name: str, report: Report, length: Length = plain) -> str:
    """Return one line about the result of a mesh or a point cloud: size, quality, time."""
    given = report["input"]
    size = translate("{} vertices").format(given["vertices"])
    if "points" in given:
        size = translate("{} over {} vertices").format(_points(given), given["vertices"])
    early = translate(", ended early") if report.get("ended_early") else ""
    said = "; ".join([quality(report, length), *warnings(report, length)])
    return f"{name}: {size}, {said}; {report['seconds']['total']:.1f} s{early}"


def _points(given: Report) -> str:
    """Say how many points there are, and which of them do not count."""
    left_out = (
        ("merged", translate("{} merged in cells")),
        ("strays", translate("{} strays left out")),
        ("duplicates", translate("{} doubles merged")),
        ("not_finite", translate("{} not finite")),
    )
    said = [words.format(given[name]) for name, words in left_out if given.get(name)]
    return translate("{} points").format(given["points"]) + (f" ({', '.join(said)})" if said else "")


def quality(report: Report, length: Length = plain) -> str:
    """Say how well the surface is approximated, in scene units and relative to its longest side."""
    if "denoise" not in report:
        return translate("{} patches, {}").format(report["patches"], _surface_error(report, report, length))
    noise = noise_removed(report["denoise"], length)
    if not report["patches"]:
        return noise
    # What the functions do to the denoised mesh: the noise is not an error of the fit.
    fitted = _surface_error(report, report["denoise"]["fit"], length)
    return translate("{}; fitted with {} patches, {}").format(noise, report["patches"], fitted)


def _surface_error(report: Report, measured: Report, length: Length) -> str:
    error, size = measured["surface_error"], report["input"]["bounding_box_longest_side"]
    rms, largest, at_vertices = error["rms"], error["max"], measured["vertex_error"]["max"]
    text = translate("surface error rms {} ({} of the size), max {} ({}), at vertices max {}")
    return text.format(length(rms), _share(rms, size), length(largest), _share(largest, size), length(at_vertices))


def warnings(report: Report, length: Length = plain) -> list[str]:
    """Say what the errors do not show: what was copied, what turned over, where nothing is known."""
    said = [
        _copied(report, length),
        _turned(report),
        _doubled(report),
        _merged(report),
        _uncut(report),
        _far_from_points(report, length),
        _outside(report, length),
        _layered(report),
        _holes(report, length),
    ]
    return [sentence for sentence in said if sentence]


def _copied(report: Report, length: Length) -> str:
    copied, vertices = report["passed_through_vertices"], report["input"]["vertices"]
    if copied == vertices and "denoise" not in report:
        if "tolerance" in report:
            text = translate("nothing could be approximated within {}: all {} vertices are the input's")
            return text.format(length(report["tolerance"]["requested"]), vertices)
        return translate("nothing could be approximated: all {} vertices are the input's").format(vertices)
    reproduced = report["vertices_reproduced"]
    text = translate("{} of {} vertices copied from the input")
    if "points" in report["input"]:
        text = translate("{} of {} vertices copied from the base, where points are too few")
    return text.format(reproduced, vertices) if reproduced else ""


def _turned(report: Report) -> str:
    turned = report["faces_turned"]
    return translate("{} of {} faces turned over").format(turned, report["input"]["faces"]) if turned else ""


def _doubled(report: Report) -> str:
    doubled = report["input"].get("coincident_vertices", 0)
    text = translate("{} vertices on open borders coincide with others and are not held together")
    return text.format(doubled) if doubled else ""


def _merged(report: Report) -> str:
    merged = report["input"].get("merged_vertices", 0)
    return translate("{} vertices held together with others at their place").format(merged) if merged else ""


def _uncut(report: Report) -> str:
    if report["settings"].get("creases") != "marked" or report["creases"]["edges"]:
        return ""
    return translate("no edge inside the mesh is marked as sharp, so there are no creases")


def _far_from_points(report: Report, length: Length) -> str:
    away = report.get("surface_to_points")
    if away is None or away["max_spacings"] <= FAR_FROM_POINTS:
        return ""
    text = translate("the surface is up to {} ({:.0f} spacings) from the nearest point")
    return text.format(length(away["max"]), away["max_spacings"])


def _outside(report: Report, length: Length) -> str:
    sought = report.get("tolerance", {})
    text = translate("{} points are farther from the surface than {}")
    return text.format(sought["points_outside"], length(sought["requested"])) if sought.get("points_outside") else ""


def _layered(report: Report) -> str:
    text = translate("the points lie in two layers: what is thinner than they are apart became one sheet")
    return text if report["input"].get("layered") else ""


def _holes(report: Report, length: Length) -> str:
    """Say how many holes were closed where that was asked for, and why none were."""
    widest = (report.get("cloud") or {}).get("close_holes")
    if not widest:
        return ""
    closed = report["input"].get("holes_closed")
    if closed is None:
        return translate("holes of the base stay open: they are closed only where the base is made")
    if not closed:
        return translate("no open hole up to {} wide was found").format(length(widest))
    return translate("holes closed: {}").format(closed)


def _share(length: float, size: float) -> str:
    return f"{length / size if size else 0.0:.2e}"


def noise_removed(noise: Report, length: Length = plain) -> str:
    """Say how much noise was removed, from that part of a report."""
    if not noise["noise_level"]:
        return translate("no noise found")
    moved = noise["displacement"]
    text = translate("noise of {} ({:.0%} of the mean edge) removed, vertices moved by rms {}, max {}")
    lengths = length(noise["noise_level"]), length(moved["rms"]), length(moved["max"])
    return text.format(lengths[0], noise["relative_noise"], *lengths[1:])


def rows(report: Report, length: Length = float) -> list[tuple[str, Any]]:
    """Return the figures of a report with their names, lengths as `length` shows them."""
    errors = [
        (f"{kind} error, {measure}", length(report[f"{kind.lower()}_error"][measure]))
        for kind in ("Vertex", "Surface")
        for measure in ("rms", "mean", "p95", "max")
    ]
    return [
        ("Method", report["method"]),
        ("Vertices", report["input"]["vertices"]),
        ("Patches", report["patches"]),
        *_noise_rows(report, length),
        *errors,
        *_guaranteed_rows(report, length),
        *_distance_rows(report, length),
        ("Normal error, degrees", report["normal_error_degrees"]),
        ("Vertices copied", report["vertices_reproduced"]),
        ("Faces turned over", report["faces_turned"]),
        ("Flipped triangles", report["flipped_triangles"]),
        ("Largest seam", length(report["seam_max"])),
        ("Seconds", report["seconds"]["total"]),
        *([("Ended early", translate("yes"))] if report.get("ended_early") else []),
    ]


def _guaranteed_rows(report: Report, length: Length) -> list[tuple[str, Any]]:
    bound = report["surface_error"].get("bound")
    if bound is not None:
        return [("Surface error, guaranteed", length(bound))]
    early = report.get("ended_early") and "points" not in report["input"]
    return [("Surface error, guaranteed", translate("not known, ended early"))] if early else []


def _distance_rows(report: Report, length: Length) -> list[tuple[str, Any]]:
    if "points_to_surface" not in report:
        return []
    ways = (("Points to surface", "points_to_surface"), ("Surface to points", "surface_to_points"))
    return [(f"{words}, {measure}", length(report[key][measure])) for words, key in ways for measure in ("rms", "max")]


def _noise_rows(report: Report, length: Length) -> list[tuple[str, Any]]:
    if "denoise" not in report:
        return []
    noise = report["denoise"]
    listed = [
        ("Noise removed", length(noise["noise_level"])),
        ("Displacement, rms", length(noise["displacement"]["rms"])),
    ]
    if report["patches"]:
        listed.append(("Fit to the denoised, rms", length(noise["fit"]["surface_error"]["rms"])))
    return listed


def table(name: str, report: Report, length: Length = float) -> str:
    """Return the rows of a report as lines of text under a name."""
    listed = [(translate(label), value) for label, value in rows(report, length)]
    cells = [(label, f"{value:.6g}" if isinstance(value, float) else str(value)) for label, value in listed]
    width = max(len(label) for label, _ in cells)
    return "\n".join([name, *(f"{label:<{width}}  {value}" for label, value in cells)])


def verdict(report: Report) -> str:
    """Say in a word how close a surface is, by its error relative to its longest side."""
    measured = report["denoise"]["fit"] if "denoise" in report and report["patches"] else report
    size = report["input"]["bounding_box_longest_side"]
    share = measured["surface_error"]["rms"] / size if size else 0.0
    return next((word for limit, word in VERDICTS if share <= limit))


VERDICTS = ((1e-4, "Very close"), (1e-3, "Close"), (1e-2, "Coarse"), (float("inf"), "Far off"))
