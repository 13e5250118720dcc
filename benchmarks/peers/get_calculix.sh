#!/usr/bin/env bash
# CalculiX for `./run bench contact`, into the folder of caches; nothing else on the machine changes. Debian 13 has no
# calculix-ccx: apt of a Debian 12 gives the packages, and checks their signatures.
#
#     bash benchmarks/peers/get_calculix.sh     # outside of ./run; prints where ccx is; the benchmark finds it there
set -euo pipefail

folder=${XDG_CACHE_HOME:-$HOME/.cache}/latin/calculix
mkdir -p "$folder"
cd "$folder"
apt-get download -qq -o APT::Sandbox::User=root calculix-ccx libspooles2.2 libarpack2
for file in ./*.deb; do
  dpkg-deb -x "$file" root
done
cat >ccx <<'SCRIPT'
#!/bin/sh
here=$(dirname "$(readlink -f "$0")")/root/usr
LD_LIBRARY_PATH=$here/lib/x86_64-linux-gnu:$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} exec "$here/bin/ccx" "$@"
SCRIPT
chmod +x ccx
echo "$folder/ccx"
