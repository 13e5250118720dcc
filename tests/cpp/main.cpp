#include <dlfcn.h>
#include <gtest/gtest.h>
#include <petscsys.h>
#include <pthread.h>

#include <cerrno>

#include "threads.hpp"

extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes,
                              void* (*start)(void*), void* argument) {
  if (NoMoreThreads::wanted) {
    return EAGAIN;
  }
  using Create = decltype(&pthread_create);
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): dlsym has no other way
  static const auto create = reinterpret_cast<Create>(dlsym(RTLD_NEXT, "pthread_create"));
  return create(thread, attributes, start, argument);
}

// The kernel never initialises PETSc (and with it MPI): its user does, here the test program.
int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  if (PetscInitialize(&argc, &argv, nullptr, nullptr) != PETSC_SUCCESS) {
    return 1;
  }
  const int failures = RUN_ALL_TESTS();
  return PetscFinalize() == PETSC_SUCCESS ? failures : 1;
}
