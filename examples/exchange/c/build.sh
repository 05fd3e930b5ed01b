#!/usr/bin/env bash
# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
#
# Generate C code from the .asn files with asn1c, and build one program with it:
#     build.sh ASN1_FOLDER OUT_FOLDER SOURCE.c|SOURCE.cpp
# Debian's asn1c (0.9.28) cannot parse ranges of REALs and lists of unnamed lists. Both are rewritten first; the encoding
# does not change. It also miscounts the bits of 64-bit integers (0 instead of 64 and 63); the generated code is corrected.
set -euo pipefail
asn1=$(realpath "$1") out=$2 source=$(realpath "$3")
mkdir -p "$out"
cd "$out"
for file in "$asn1"/*.asn; do
    sed -E \
        -e 's/^(T-(Double|Float) *::= REAL) \(.*\)/\1/' \
        -e 's/SEQUENCE \(SIZE\(([2346])\)\) OF SEQUENCE \(SIZE\(\1\)\) OF T-Double/SEQUENCE (SIZE(\1)) OF Vector\1d/' \
        -e 's/^(MatrixXd *::= SEQUENCE \(SIZE\(0\.\.20\)\) OF) (SEQUENCE .*)/\1 MatrixXd-Row\nMatrixXd-Row ::= \2/' \
        "$file" >"$(basename "$file")"
done
if [[ ! -f types.a ]]; then
    asn1c -gen-PER -fcompound-names ./*.asn >asn1c.log 2>&1
    rm -f converter-sample.c
    sed -E -i \
        -e 's/(APC_CONSTRAINED,\t) 0, -1, -9223372036854775807,/\1 64, -1, -9223372036854775807,/' \
        -e 's/(APC_CONSTRAINED,\t) 0, -1,  0,  9223372036854775807 /\1 63, -1,  0,  9223372036854775807 /' ./*.c
    find . -maxdepth 1 -name '*.c' -print0 | xargs -0 -n 40 -P 2 "${CC:-gcc}" -O1 -w -I. -c
    ar -rc types.a ./*.o
fi
case $source in
    *.cpp) compiler=${CXX:-g++} ;;
    *) compiler=${CC:-gcc} ;;
esac
program=$(basename "${source%.*}")-${source##*.}
"$compiler" -O1 -w -I. -o "$program" "$source" types.a -lm
echo "$out/$program"
