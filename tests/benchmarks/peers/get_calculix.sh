#!/usr/bin/env bash
# CalculiX for `./run bench contact`, into the folder of caches; nothing else on the machine changes. Debian 13 has no
# calculix-ccx, so these are the packages of Debian 12, checked by their sums. Needs curl or python3, dpkg-deb.
#
#     ./run bash tests/benchmarks/peers/get_calculix.sh     # prints where ccx is; the benchmark finds it there
set -euo pipefail

folder=${XDG_CACHE_HOME:-$HOME/.cache}/latin/calculix
mirror=http://deb.debian.org/debian/pool/main
packages=(
  c/calculix-ccx/calculix-ccx_2.20-1_amd64.deb a448239f3caf5a324f9589a636e595e3e676153489f75843e509decb6809f346
  s/spooles/libspooles2.2_2.2-14_amd64.deb 51faa6a5aad9aba20beadffba5d4d9e28fa7a5ef426a1d4fa16c825fd80034a0
  a/arpack/libarpack2_3.8.0-3_amd64.deb 949773b357e8f4c74fbc585f2fbee452adb2931c3d36a5baf8eae49f7d45bede
)

mkdir -p "$folder"
cd "$folder"
for ((i = 0; i < ${#packages[@]}; i += 2)); do
  file=${packages[i]##*/}
  [[ -f $file ]] || python3 -c 'import sys, urllib.request; urllib.request.urlretrieve(*sys.argv[1:])' "$mirror/${packages[i]}" "$file"
  echo "${packages[i + 1]}  $file" | sha256sum --check --quiet
  dpkg-deb -x "$file" root
done
cat >ccx <<'SCRIPT'
#!/bin/sh
here=$(dirname "$(readlink -f "$0")")/root/usr
LD_LIBRARY_PATH=$here/lib/x86_64-linux-gnu:$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} exec "$here/bin/ccx" "$@"
SCRIPT
chmod +x ccx
./ccx -v || true
echo "$folder/ccx"
