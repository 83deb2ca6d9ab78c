"""Approximate every mesh file of a folder, one after the other; a refused file does not stop the rest.

    blender --background --python examples/approximate_folder.py -- models results --preset fast
    python examples/approximate_folder.py models results --preset fast

For each file the second folder gets the result as .ply, its heat map as .png and its report as .json.
All further arguments are passed on to `sparse_surface approximate`.  On a render farm each machine can take
files of its own: --part 2/5 is the second of five.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import extension


def share(text: str) -> tuple[int, int]:
    """Return I and N of "I/N"."""
    first, _, second = text.partition("/")
    if not (first.isdecimal() and second.isdecimal() and 1 <= int(first) <= int(second)):
        raise argparse.ArgumentTypeError(f"'{text}' is not I/N, such as 2/5")
    return int(first), int(second)


def main() -> int:
    parser = argparse.ArgumentParser(description="Approximate every mesh file of a folder.")
    parser.add_argument("models", type=Path, help="folder with mesh files")
    parser.add_argument("results", type=Path, help="folder for the results, made where it is missing")
    parser.add_argument("--part", type=share, default=(1, 1), metavar="I/N", help="the I-th of N shares of the files")
    options, settings = parser.parse_known_args(extension.arguments())
    package = extension.package().__name__
    command_line = importlib.import_module(f"{package}.command_line.main")
    formats = importlib.import_module(f"{package}.operators.files.formats")
    number, parts = options.part
    if not options.models.is_dir():
        parser.error(f"there is no folder '{options.models}'")
    if options.results.resolve() == options.models.resolve():
        parser.error("the results need a folder of their own: they would replace the models")
    files = sorted(file for file in options.models.iterdir() if file.suffix.lower() in formats.READABLE)
    options.results.mkdir(parents=True, exist_ok=True)
    refused = []
    own = files[number - 1 :: parts]
    stems = [file.stem for file in files]
    for file in own:
        # "part.obj" and "part.ply" get results of their own
        made = options.results / (file.name if stems.count(file.stem) > 1 else file.stem)
        outputs = ["-o", f"{made}.ply", "--report", f"{made}.json", "--heatmap", f"{made}.png"]
        if command_line.main(["approximate", str(file), *outputs, *settings]) != 0:
            refused.append(file.name)
    print(f"{len(own) - len(refused)} approximated" + (f", refused: {', '.join(refused)}" if refused else ""))
    return 1 if refused else 0


if __name__ == "__main__":
    # Blender keeps running after a script; sys.exit ends it with the code.
    sys.exit(main())
