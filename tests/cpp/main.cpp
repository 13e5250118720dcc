#include <gtest/gtest.h>
#include <petscsys.h>

// The kernel never initialises PETSc (and with it MPI): its user does, here the test program.
int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  if (PetscInitialize(&argc, &argv, nullptr, nullptr) != PETSC_SUCCESS) {
    return 1;
  }
  const int failures = RUN_ALL_TESTS();
  return PetscFinalize() == PETSC_SUCCESS ? failures : 1;
}
