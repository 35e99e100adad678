#!/bin/sh
# Runs flexbeams under a Python for 64-bit ARM, in qemu, and compares with this machine: build, run tracking, export,
# validate: tests/native/arm_python.sh [FOLDER] (default build/arm_python, about 1 GB). Takes some 10 minutes.
# Needs Debian's apt and qemu-user, and `python` with flexbeams and ziglang. Python and its libraries are Debian's and
# PyPI's for arm64; the compiler is this machine's zig, which would otherwise take an hour: it builds for arm64 alike.
set -eu
folder=${1:-build/arm_python}
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
root=$folder/root
site=$folder/site
run=$folder/run

if [ ! -d "$root" ]; then
    echo "+ Python of Debian for arm64"
    mkdir -p "$folder/apt/lists/partial" "$folder/apt/archives/partial"
    : >"$folder/apt/status"
    . /etc/os-release
    echo "deb http://deb.debian.org/debian $VERSION_CODENAME main" >"$folder/apt/sources"
    cat >"$folder/apt/conf" <<EOF
APT::Architecture "arm64";
APT::Architectures "arm64";
APT::Install-Recommends "false";
Dir::State "$folder/apt";
Dir::State::status "$folder/apt/status";
Dir::Cache "$folder/apt";
Dir::Etc::sourcelist "$folder/apt/sources";
Dir::Etc::sourceparts "-";
EOF
    APT_CONFIG=$folder/apt/conf apt-get update -qq
    APT_CONFIG=$folder/apt/conf apt-get install -qq -y --download-only python3 libstdc++6 zlib1g >/dev/null
    mkdir "$root"
    for package in "$folder"/apt/archives/*.deb; do
        dpkg-deb -x "$package" "$root"
    done
fi
interpreter=$(basename "$(ls "$root"/usr/bin/python3.?? | head -n 1)")

if [ ! -d "$site" ]; then
    echo "+ wheels for arm64"
    python -c "
import tomllib
print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['dependencies'], sep='\n')" >"$folder/requirements.txt"
    python -m pip install -q --target "$site" --only-binary=:all: --implementation cp \
        --python-version "${interpreter#python}" --platform manylinux_2_17_aarch64 --platform manylinux2014_aarch64 \
        --platform manylinux_2_28_aarch64 -r "$folder/requirements.txt"
    mkdir "$site/ziglang"
    : >"$site/ziglang/__init__.py"
    zig=$(python -c "import ziglang, os; print(os.path.join(os.path.dirname(ziglang.__file__), 'zig'))")
    echo "import os, sys; os.execv('$zig', ['$zig', *sys.argv[1:]])" >"$site/ziglang/__main__.py"
fi

echo "+ flexbeams"
rm -rf "$folder/sources" "$run"
mkdir -p "$folder/sources" "$run"
git ls-files -z | xargs -0 tar cf - | tar xf - -C "$folder/sources"
python -m pip install -q --target "$site" --no-deps --upgrade "$folder/sources"

# A script in the place of the interpreter: child processes start it again, without support by the kernel
cat >"$folder/python" <<EOF
#!/bin/sh
PYTHONHOME=$root/usr PYTHONPATH=$site FLEXBEAMS_CACHE=$run/cache OPENBLAS_NUM_THREADS=1 \\
    exec qemu-aarch64 -L $root -0 $folder/python $root/usr/bin/$interpreter "\$@"
EOF
chmod +x "$folder/python"
here=$(command -v python)

cd "$run"
"$folder/python" -c "import platform; assert platform.machine() == 'aarch64'"
for command in "build --out units" "run tracking --out arm" "export tracking -o tracking.ssp" \
    "export tracking --format closed-loop -o loop.fmu" "validate units/native/BeamPlant.fmu \
    units/native/FlatnessFeedforward.fmu units/native/TrackingController.fmu tracking.ssp loop.fmu" \
    "run tracking.ssp --out package"; do
    echo "+ flexbeams $command"
    "$folder/python" -m flexbeams $command
done

echo "+ comparison"
PYTHONPATH=$folder/sources "$here" -m flexbeams run tracking --out here >/dev/null
"$here" - <<'EOF'
import sys
from pathlib import Path

import numpy as np


def signals(folder):
    file = next(Path(folder).rglob("results.csv"))
    return np.genfromtxt(file, delimiter=",", names=True, deletechars="")


here, failed = signals("here"), False
for folder in ("arm", "package"):
    there = signals(folder)
    names = [name for name in here.dtype.names if name in there.dtype.names]
    differences = [np.max(np.abs(there[n] - here[n])) / max(np.max(np.abs(here[n])), 1e-300) for n in names]
    print(f"{folder}: {len(names)} signals, {len(there)} rows, largest difference {max(differences):.1e}")
    failed |= not (len(names) > 30 and len(there) == len(here) and max(differences) <= 1e-9)
sys.exit(failed)
EOF
