#!/bin/sh
# Fuzzes the units for as long as wanted: tests/native/fuzz.sh RUNS FOLDER (default 4000000 inputs for each unit).
# Corpora, logs and failing inputs stay in FOLDER. Needs clang with libFuzzer (Debian: clang libclang-rt-dev).
set -eu
runs=${1:-4000000}
folder=${2:-build/fuzz}
mkdir -p "$folder"
python -c "
import shutil, sys
from pathlib import Path
from tests.native.workshop import INCLUDES, NATIVE_UNITS, guid_of, source_folder
for unit in NATIVE_UNITS:
    folder = Path(sys.argv[1], unit)
    shutil.copytree(source_folder(unit, small=True), folder, dirs_exist_ok=True)
    (folder / 'guid').write_text(guid_of(unit, small=True))
Path(sys.argv[1], 'includes').write_text(' '.join(INCLUDES))
" "$folder"
for unit in BeamPlant FlatnessFeedforward TrackingController BeamClosedLoop; do
    clang -O1 -g -std=c99 -fsanitize=fuzzer,address,undefined,float-cast-overflow -fno-sanitize-recover=all \
        -DUNIT_GUID="\"$(cat "$folder/$unit/guid")\"" -DFMI2_OVERRIDE_FUNCTION_PREFIX $(cat "$folder/includes") \
        "$folder/$unit/$unit.c" tests/native/fuzz.c -o "$folder/fuzz_$unit" -lm
    mkdir -p "$folder/corpus_$unit"
    "$folder/fuzz_$unit" -runs="$runs" -max_len=300 -print_final_stats=1 -artifact_prefix="$folder/$unit-" \
        "$folder/corpus_$unit" 2>&1 | tee "$folder/$unit.log"
done
