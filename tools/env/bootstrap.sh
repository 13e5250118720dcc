# Finds or makes the environment in which the project is built and run. Sourced by `run`.
#
# After `ensure_environment ARGS...` either LATIN_ENVIRONMENT (name of the environment, also the name
# of its build folder) and LATIN_PYTHON (its interpreter) are set, or the process has been replaced by
# `run ARGS...` inside a private Debian root.
# shellcheck shell=bash

latin_default_suite=trixie
latin_root_size="about 0.8 GB to download, 4 GB on disk, 3 to 4 minutes"

say() { printf 'latin: %s\n' "$*" >&2; }
die() { say "$@"; exit 1; }

# Names in the package list, and in the suite's own list if it has one; sorted, without comments.
package_list() { # [SUITE]
  local lists=("$latin_home/tools/env/packages.txt") own=$latin_home/tools/env/packages.${1:-}.txt
  if [[ -n ${1:-} && -f $own ]]; then lists+=("$own"); fi
  sed -e 's/#.*//' -e 's/[[:space:]]//g' -e '/^$/d' "${lists[@]}" | LC_ALL=C sort -u
}

# Options of mmdebstrap that do not depend on the place of the root; they are part of its key.
root_options() { # SUITE
  printf '%s\n' --mode=root --variant=minbase --components=main --dpkgopt='path-exclude=/usr/share/man/*' \
    --dpkgopt='path-exclude=/usr/share/info/*' --dpkgopt='path-exclude=/usr/share/locale/*'
  # A mirror's copy of sid can be older than its release file allows; signatures are still checked.
  if [[ $1 == sid ]]; then printf '%s\n' --aptopt='Acquire::Check-Valid-Until "false"'; fi
}

root_key() { # SUITE
  local hash
  hash=$({ package_list "$1"; root_options "$1"; } | sha256sum)
  printf '%s-%s\n' "$1" "${hash:0:12}"
}

cache_folder() { printf '%s/latin\n' "${XDG_CACHE_HOME:-$HOME/.cache}"; }

# Is VERSION (of a Debian package, or of a module) at least dolfinx 0.9?
is_new_enough() {
  [[ $1 =~ ^([0-9]+:)?([0-9]+)\.([0-9]+) ]] || return 1
  ((BASH_REMATCH[2] > 0 || BASH_REMATCH[3] >= 9))
}

# Exit code 0: dolfinx and PETSc can be used from this interpreter; prints what pip could add.
latin_probe='
import importlib.metadata as metadata, importlib.util as util, os, shutil, sys

def version(name):
    try:
        return tuple(int(part) for part in metadata.version(name).split(".")[:2])
    except Exception:
        return (0, 0)

def has_petsc_headers():
    if util.find_spec("petsc4py") is None:
        return False
    import petsc4py
    config = petsc4py.get_config()  # several builds at once in the dolfinx container: "first:second"
    folder = os.environ.get("PETSC_DIR", config["PETSC_DIR"])
    arch = os.environ.get("PETSC_ARCH", config["PETSC_ARCH"].split(os.pathsep)[0])
    parts = (folder, arch), (folder, "")
    return any(os.path.exists(os.path.join(*part, "include", "petscconf.h")) for part in parts)

if sys.version_info < (3, 11) or version("fenics-dolfinx") < (0, 9) or not has_petsc_headers():
    sys.exit(1)
if not any(map(shutil.which, (os.environ.get("CXX", "c++"), "g++", "clang++"))):
    sys.exit(1)
modules = {"pip": "pip", "pybind11": "pybind11", "scikit-build-core": "scikit_build_core",
           "gmsh": "gmsh", "scipy": "scipy", "matplotlib": "matplotlib", "pytest": "pytest",
           "pytest-timeout": "pytest_timeout", "pytest-xdist": "xdist", "hypothesis": "hypothesis"}
missing = [name for name, module in modules.items() if util.find_spec(module) is None]
missing += [name for name, tool in (("cmake", "cmake"), ("ninja", "ninja")) if not shutil.which(tool)]
print(*missing)
'

# The first interpreter with a usable dolfinx becomes LATIN_PYTHON; what it lacks, LATIN_MISSING.
find_active_environment() {
  local python hash
  for python in "$(command -v python3 || true)" /usr/bin/python3; do
    [[ -x $python ]] || continue
    LATIN_MISSING=$("$python" -c "$latin_probe" 2>/dev/null) || continue
    hash=$({ echo "$python"; "$python" -VV; } | sha256sum)
    LATIN_PYTHON=$python LATIN_ENVIRONMENT=local-${hash:0:12}
    export LATIN_PYTHON LATIN_ENVIRONMENT
    return 0
  done
  return 1
}

as_root() { if ((EUID == 0)); then "$@"; else sudo "$@"; fi; }

can_be_root() {
  ((EUID == 0)) && return 0
  command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [[ -t 0 && -t 2 ]]; }
}

# Does this system's own apt offer a dolfinx that is new enough?
apt_offers_dolfinx() {
  command -v apt-get >/dev/null || return 1
  local id version
  id=$(. /etc/os-release && echo "$ID") version=$(. /etc/os-release && echo "${VERSION_ID:-rolling}")
  if [[ $id == debian ]]; then [[ $version == rolling || ${version%%.*} -ge 13 ]]; return; fi
  is_new_enough "$(apt-cache policy python3-dolfinx 2>/dev/null | sed -n 's/^ *Candidate: //p')"
}

apt_install() { # PACKAGE...
  as_root env DEBIAN_FRONTEND=noninteractive apt-get update -qq </dev/null >&2 &&
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends -o Dpkg::Use-Pty=0 "$@" </dev/null >&2
}

install_system_packages() {
  local packages missing
  mapfile -t packages < <(package_list)
  mapfile -t missing < <(comm -23 <(package_list) \
    <(dpkg-query -W -f '${db:Status-Abbrev} ${Package}\n' "${packages[@]}" 2>/dev/null | sed -n 's/^ii *//p' | LC_ALL=C sort))
  ((${#missing[@]} == 0)) && return 0
  say "installing ${#missing[@]} Debian packages with apt-get (at most $latin_root_size): ${missing[*]}"
  apt_install "${missing[@]}"
}

can_make_root() {
  ((EUID == 0)) && command -v unshare chroot flock >/dev/null && unshare --mount true 2>/dev/null &&
    { [[ -d $(cache_folder)/$(root_key "$1") ]] || command -v mmdebstrap apt-get >/dev/null; }
}

# Can nobody but root (and who called sudo) change what is in a folder, or put another one in its place? Says who can.
# What is in the private root runs as root: so would what somebody else has put there.
is_own() { # FOLDER
  local folder mode owner
  folder=$(readlink -f "$1")
  while :; do
    read -r mode owner < <(stat -c '%a %u' "$folder")
    # others may write to a folder like /tmp, where nobody can move what is not his own
    if ((8#$mode & 8#022)) && ! ((8#$mode & 8#1000)); then
      say "$folder can be changed by others (mode $mode)"
      return 1
    fi
    if [[ $owner != 0 && $owner != "${SUDO_UID:-0}" ]]; then
      say "$folder belongs to $(stat -c %U "$folder"), who could put anything there"
      return 1
    fi
    [[ $folder != / ]] || return 0
    folder=${folder%/*}
    folder=${folder:-/}
  done
}

# Builds the private root beside its place, then renames it: a half-built one is never used.
make_root() { # SUITE ROOT
  local suite=$1 root=$2 part=$2.part free options
  (
    umask 022
    mkdir -p "${root%/*}"
  )
  is_own "${root%/*}" || die "no environment is made there: set XDG_CACHE_HOME to a folder of root's"
  (
    if ! flock -n 9; then
      say "another run is preparing the Debian environment, waiting for it"
      flock 9
    fi
    [[ -d $root ]] && exit 0
    say "no dolfinx >= 0.9 here: making a private Debian environment ($suite), once for all clones"
    say "  in $root: $latin_root_size; nothing else on this machine changes"
    free=$(df --output=avail -k "${root%/*}" | tail -n 1)
    ((free > 5000000)) || die "only $((free / 1000)) MB free in ${root%/*}, 5000 MB are needed; free some, or set XDG_CACHE_HOME"
    if ! command -v mmdebstrap >/dev/null; then
      say "installing mmdebstrap with apt-get"
      apt_install mmdebstrap debian-archive-keyring 9>&- || die "apt-get could not install mmdebstrap"
    fi
    rm -rf --one-file-system "$part"
    mapfile -t options < <(root_options "$suite")
    SECONDS=0
    if ! mmdebstrap "${options[@]}" --include="$(package_list "$suite" | paste -sd,)" "$suite" "$part" </dev/null >&2 9>&-; then
      rm -rf --one-file-system "$part"
      die "the Debian environment could not be made; the reason is above"
    fi
    : >"$part/etc/resolv.conf"
    mv "$part" "$root"
    say "environment ready after $SECONDS s; environments of other package lists, if any, can be deleted from ${root%/*}"
  ) 9>"$root.lock"
}

# Variables that describe the programs, libraries and languages of the host, which the root does not have.
# A display is one of them: the root draws without.
latin_host_variables='PATH|MANPATH|INFOPATH|LD_.*|LIBRARY_PATH|CPATH|C_INCLUDE_PATH|CPLUS_INCLUDE_PATH|PKG_CONFIG.*|CMAKE_.*
  |CC|CXX|CPP|FC|F77|AR|LD|NM|RANLIB|[A-Z]*FLAGS|PYTHON.*|VIRTUAL_ENV.*|CONDA.*|_CE_.*|MAMBA_.*|PYENV.*|PIP_.*|UV_.*
  |PETSC_DIR|PETSC_ARCH|SLEPC_.*|MPI.*|OMPI_.*|PMIX_?.*|PMI_.*|PRTE_.*|I_MPI_.*|HYDRA_.*|SLURM_.*|MODULE.*|LMOD.*|LOADEDMODULES|_LM.*
  |PERL.*|RUBY.*|GEM_.*|NODE_.*|TCL.*|TK_.*|QT_.*|GTK.*|GI_.*|GIO_.*|GCONV_PATH|LOCPATH|NLSPATH|LANG|LANGUAGE|LC_.*
  |XDG_(CONFIG|DATA)_DIRS|XDG_(RUNTIME_DIR|SESSION.*|SEAT.*|VTNR|CURRENT_DESKTOP)|DBUS_.*|DISPLAY|WAYLAND_DISPLAY|XAUTHORITY
  |SHELL|SHELLOPTS|BASHOPTS|BASH_ENV|ENV|PS[0-4]|_|PWD|OLDPWD|SHLVL|HOME|TMPDIR|DEBIAN_FRONTEND|APT_.*|DPKG_.*
  |LATIN_(ENVIRONMENT|PYTHON|MISSING)'

# Names of the variables that are handed on into the private root: the user's own.
handed_on() { compgen -e | grep -vxE "${latin_host_variables//[[:space:]]/}" || true; }

# Folders of the host that must not cover the ones of the root.
is_system_folder() {
  case $1 in
    /usr/src/* | /usr/local/src/* | /usr/home/* | /run/media/*) return 1 ;;
    / | /bin | /boot | /etc | /etc/* | /lib | /lib64 | /run | /run/* | /sbin | /usr | /usr/* | /var | /var/lib | /var/cache) return 0 ;;
    *) return 1 ;;
  esac
}

# Folders that are the user's, each ended by a zero byte: /home, /root, /mnt, /opt, /tmp, /var/tmp, /data, ...
# What Linux and Debian have under the same names is left out, and so are folders that are not there.
user_folders() { # [TOP]
  local top=${1:-} folder
  for folder in "$top"/* "$top"/.[!.]* "$top"/var/* "$top"/run/media; do
    [[ -d $folder ]] || continue
    case ${folder#"$top"} in
      /bin | /boot | /dev | /efi | /etc | /lib | /lib[0-9]* | /libx32 | /lost+found | /proc | /run | /sbin | /sys | /usr | /var) ;;
      /var/backups | /var/cache | /var/crash | /var/db | /var/empty | /var/lib | /var/lock | /var/log | /var/mail) ;;
      /var/run | /var/spool | /var/lost+found) ;;
      *) printf '%s\0' "$folder" ;;
    esac
  done
}

# Shows a folder of the host at the same place in the root. A link to a folder is shown as that folder.
show_folder() { # ROOT FOLDER
  [[ ! $2 -ef $1$2 ]] || return 0
  mkdir -p "$1$2" && mount --rbind "$(readlink -f "$2")" "$1$2"
}

# Runs in a mount namespace of its own: the mounts vanish with the process.
mount_and_chroot() { # ROOT FOLDER_TO_SHOW... -- COMMAND...
  set -e
  local root=$1 folder file
  shift
  # the folder that holds the root comes first, with nothing mounted in it
  while IFS= read -r -d '' folder; do
    [[ $root/ != "$(readlink -f "$folder")"/* ]] || show_folder "$root" "$folder"
  done < <(user_folders)
  while IFS= read -r -d '' folder; do
    show_folder "$root" "$folder" || printf 'latin: %s cannot be shown in the private root\n' "$folder" >&2
  done < <(user_folders)
  for folder in /proc /sys /dev; do mount --rbind "$folder" "$root$folder"; done
  for file in /etc/resolv.conf /etc/hosts; do
    if [[ -e $file && -e $root$file ]]; then mount --bind "$(readlink -f "$file")" "$root$file"; fi
  done
  while [[ $1 != -- ]]; do
    show_folder "$root" "$1"
    shift
  done
  shift
  exec chroot "$root" "$@"
}

# Replaces this process by `run ARGS...` in the root: signals, terminal and exit code are the program's.
enter_root() { # ROOT ARGS...
  local root here home=${HOME:-/root} folders variables=() name
  root=$(readlink -f "$1") here=$(pwd -P)
  shift
  is_system_folder "$here" && die "run cannot work from $here (the environment has its own): change to another folder"
  is_system_folder "$latin_home" && die "the project cannot be used in $latin_home, a folder of the system: move it"
  folders=("$here" "$latin_home")
  # a service may have its home folder in a folder of the system, or none
  if [[ -d $home ]] && ! is_system_folder "$(readlink -f "$home")"; then folders+=("$home"); else home=/root; fi
  if [[ -d ${TMPDIR:-} ]] && ! is_system_folder "$(readlink -f "$TMPDIR")"; then
    variables+=("TMPDIR=$TMPDIR") folders+=("$TMPDIR")
  fi
  while IFS= read -r name; do variables+=("$name=${!name}"); done < <(handed_on)
  # mounts that the host makes later (an automatic one of a home folder, a disk) appear as well
  exec unshare --mount --propagation slave \
    bash -c "$(declare -f user_folders show_folder mount_and_chroot); mount_and_chroot \"\$@\"" run "$root" "${folders[@]}" -- \
    /usr/bin/env -i --chdir="$here" USER=root LOGNAME=root "${variables[@]}" HOME="$home" PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    LANG=C.UTF-8 SHELL=/bin/bash LATIN_ENVIRONMENT="${root##*/}" LATIN_PYTHON=/usr/bin/python3 \
    bash "$latin_home/run" "$@"
}

explain_and_stop() {
  cat >&2 <<'EOF'
latin: dolfinx >= 0.9 with petsc4py and PETSc's headers was not found, and could not be installed here.
Three ways to get it, any of them will do:
  conda      conda create -n latin -c conda-forge fenics-dolfinx python-gmsh pybind11 scikit-build-core \
               cmake ninja cxx-compiler eigen suitesparse scipy matplotlib pytest pytest-timeout pytest-xdist hypothesis
             conda activate latin
  container  docker run -it -v "$PWD:$PWD" -w "$PWD" dolfinx/dolfinx:stable
  Debian 13  as root or with sudo (or any Linux as root with mmdebstrap and the right to mount)
then call ./run again.
EOF
  exit 1
}

ensure_environment() { # ARGS...
  [[ -n ${LATIN_ENVIRONMENT:-} ]] && return 0
  local suite=${LATIN_SUITE:-$latin_default_suite} root
  if [[ -z ${LATIN_SUITE:-} ]]; then
    find_active_environment && [[ -z $LATIN_MISSING ]] && return 0
    if apt_offers_dolfinx && can_be_root; then
      install_system_packages || die "apt-get failed; the reason is above"
      PATH=/usr/bin:$PATH find_active_environment && return 0
    fi
    # dolfinx is there; pip adds the rest to the environment of this clone
    [[ -n ${LATIN_ENVIRONMENT:-} ]] && return 0
  fi
  can_make_root "$suite" || explain_and_stop
  root=$(cache_folder)/$(root_key "$suite")
  [[ -d $root ]] || make_root "$suite" "$root" || exit 1
  is_own "$root" || die "this environment is not entered: set XDG_CACHE_HOME to a folder of root's"
  enter_root "$root" "$@"
}
