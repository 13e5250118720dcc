# Options of the sanitizers for `./run test --sanitize`. Sourced by `run`.
# shellcheck shell=bash

export ASAN_OPTIONS=detect_stack_use_after_return=1:strict_string_checks=1:check_initialization_order=1
export LSAN_OPTIONS=suppressions=$latin_home/tools/sanitize/leaks.txt:print_suppressions=0
export UBSAN_OPTIONS=print_stacktrace=1:halt_on_error=1
