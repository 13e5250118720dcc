#pragma once

#include <pybind11/pybind11.h>

#include <utility>

#include "latin/common/interrupt.hpp"

/// Call what takes long, without the lock of the interpreter, so that Ctrl-C ends it with KeyboardInterrupt.
/// @param listens not on several ranks: others would wait
template <class Call>
auto hearing_signals(bool listens, Call&& call) {
  latin::Interruptible ending([listens] {
    const pybind11::gil_scoped_acquire gil;
    if (listens && PyErr_CheckSignals() != 0) {
      throw pybind11::error_already_set();
    }
    return false;
  });
  try {
    return std::forward<Call>(call)();
  } catch (const latin::Interrupted&) {
    ending.pass_on();
    throw;
  }
}
