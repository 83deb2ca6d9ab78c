#!/bin/sh
# Print the path of the first Python among the wanted versions that really runs and can make virtual environments.
# usage: scripts/find_python.sh [VERSION...]      (default: 3.11 3.13; $PYTHON is tried first)
set -u
probe='import ensurepip, platform, sys, venv; print("%d.%d" % sys.version_info[:2], platform.python_implementation())'

usable() { # a name on PATH may be a shim that exists but does not run, so ask it
    [ "$("$1" -c "$probe" 2>/dev/null)" = "$2 CPython" ]
}

candidates() {
    [ -n "${PYTHON:-}" ] && printf '%s\n' "$PYTHON"
    printf '%s\n' "python$1" python3 python
    for folder in "${PYENV_ROOT:-$HOME/.pyenv}"/versions/*/bin "$HOME"/.local/share/uv/python/*/bin "$HOME"/.local/bin \
        /usr/bin /usr/local/bin /opt/*/bin /opt/homebrew/bin /Library/Frameworks/Python.framework/Versions/*/bin; do
        [ -x "$folder/python$1" ] && printf '%s\n' "$folder/python$1"
    done
    return 0
}

[ $# -eq 0 ] && set -- 3.11 3.13
for version in "$@"; do
    candidates "$version" | {
        while IFS= read -r candidate; do
            if usable "$candidate" "$version"; then
                "$candidate" -c 'import sys; print(sys.executable)'
                exit 0
            fi
        done
        exit 1
    } && exit 0
done
echo "No Python $(echo "$*" | sed 's/ / or /g') with venv was found; name one with PYTHON=/path/to/python." >&2
exit 1
