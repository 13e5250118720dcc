#include <gtest/gtest.h>
#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/lsan_interface.h>
#endif

#include <cmath>
#include <limits>
#include <memory>
#include <type_traits>
#include <vector>

#include "algebra/handle.hpp"
#include "latin/common/error.hpp"

using latin::algebra::MatHandle;
using latin::algebra::VecHandle;

namespace {

/// References that exist to a PETSc object.
template <typename Object>
PetscInt references(Object object) {
  PetscInt count = 0;
  latin::algebra::check(PetscObjectGetReference(reinterpret_cast<PetscObject>(object), &count),
                        "count references");
  return count;
}

/// ( 1 0 0 )
/// ( 0 2 x )  with an explicit zero at (0, 1), and more empty rows if asked for.
Mat example(double x, PetscInt rows = 2) {
  Mat matrix = nullptr;
  latin::algebra::check(MatCreateSeqAIJ(PETSC_COMM_SELF, rows, 3, 3, nullptr, &matrix),
                        "create a matrix");
  const auto set = [matrix](PetscInt row, PetscInt column, double value) {
    latin::algebra::check(MatSetValue(matrix, row, column, value, INSERT_VALUES), "set a value");
  };
  set(0, 0, 1.0);
  set(0, 1, 0.0);
  set(1, 1, 2.0);
  set(1, 2, x);
  latin::algebra::check(MatAssemblyBegin(matrix, MAT_FINAL_ASSEMBLY), "assemble");
  latin::algebra::check(MatAssemblyEnd(matrix, MAT_FINAL_ASSEMBLY), "assemble");
  return matrix;
}

/// What an InputError or NumericalError says.
template <typename Error, typename Action>
std::string message(Action&& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

/// They end after main() has finalised PETSc.
// NOLINTNEXTLINE(cppcoreguidelines-avoid-non-const-global-variables)
MatHandle outlives_petsc;
// NOLINTNEXTLINE(cppcoreguidelines-avoid-non-const-global-variables)
std::shared_ptr<const latin::SparseView> looks_longer_than_petsc;

}  // namespace

/// What is wrong ends the program with MPI's own message, after all tests.
TEST(Handle, MayOutlivePetsc) {
#ifdef __SANITIZE_ADDRESS__
  // PETSc ends with what it counts of the matrix' communicator
  const __lsan::ScopedDisabler no_leak;
#endif
  outlives_petsc = MatHandle::adopt(example(3.0, 3));
  looks_longer_than_petsc = latin::algebra::view_sparse(outlives_petsc.get(), "part");
  EXPECT_TRUE(latin::algebra::petsc_is_there());
}

TEST(View, LooksAtAndKeepsPetscsOwnArrays) {
  Mat matrix = example(3.0, 3);
  const auto view = latin::algebra::view_sparse(matrix, "part");
  const double* values = nullptr;
  latin::algebra::check(MatSeqAIJGetArrayRead(matrix, &values), "read values");
  EXPECT_EQ(view->valuePtr(), values);
  latin::algebra::check(MatSeqAIJRestoreArrayRead(matrix, &values), "release values");
  latin::algebra::check(MatDestroy(&matrix), "destroy");  // the view has a reference of its own
  EXPECT_EQ(view->nonZeros(), 4);                         // the explicit zero is there
  const latin::Matrix dense = *view * latin::Matrix::Identity(3, 3);
  EXPECT_EQ(dense, (latin::Matrix(3, 3) << 1, 0, 0, 0, 2, 3, 0, 0, 0).finished());
}

TEST(View, RefusesNanWithItsRow) {
  const MatHandle bad = MatHandle::adopt(example(std::numeric_limits<double>::quiet_NaN(), 3));
  EXPECT_NE(message<latin::InputError>([&] {
              static_cast<void>(latin::algebra::view_sparse(bad.get(), "part"));
            }).find("'part' holds a NaN or infinity in row 1"),
            std::string::npos);
}

TEST(Handle, AdoptTakesOverTheReference) {
  Mat raw = example(3.0);
  Mat witness = raw;
  latin::algebra::check(PetscObjectReference(reinterpret_cast<PetscObject>(raw)), "reference");
  ASSERT_EQ(references(witness), 2);
  {
    const MatHandle handle = MatHandle::adopt(raw);
    EXPECT_EQ(handle.get(), raw);
    EXPECT_EQ(references(witness), 2);
  }
  EXPECT_EQ(references(witness), 1);
  latin::algebra::check(MatDestroy(&witness), "destroy");
}

TEST(Handle, BorrowTakesAnotherOne) {
  const MatHandle owner = MatHandle::adopt(example(3.0));
  {
    const MatHandle second = MatHandle::borrow(owner.get());
    EXPECT_EQ(second.get(), owner.get());
    EXPECT_EQ(references(owner.get()), 2);
    const MatHandle third = MatHandle::borrow(second.get());
    EXPECT_EQ(references(owner.get()), 3);
  }
  EXPECT_EQ(references(owner.get()), 1);
}

TEST(Handle, MovesWithoutCounting) {
  static_assert(!std::is_copy_constructible_v<MatHandle> && !std::is_copy_assignable_v<MatHandle>);
  static_assert(std::is_nothrow_move_constructible_v<MatHandle>);
  const MatHandle owner = MatHandle::adopt(example(3.0));
  MatHandle first = MatHandle::borrow(owner.get());
  MatHandle second(std::move(first));
  EXPECT_EQ(first.get(),
            nullptr);  // NOLINT(bugprone-use-after-move): what a move leaves is its contract
  EXPECT_EQ(references(owner.get()), 2);
  MatHandle third = MatHandle::adopt(example(4.0));
  third = std::move(second);
  EXPECT_EQ(third.get(), owner.get());
  EXPECT_EQ(references(owner.get()), 2);
  third = MatHandle();
  EXPECT_EQ(third.get(), nullptr);
  EXPECT_EQ(references(owner.get()), 1);
}

TEST(Handle, ReceivesWhatPetscCreates) {
  VecHandle vector;
  EXPECT_EQ(vector.get(), nullptr);
  latin::algebra::check(VecCreateSeq(PETSC_COMM_SELF, 4, vector.out()), "create a vector");
  PetscInt size = 0;
  latin::algebra::check(VecGetSize(vector.get(), &size), "measure a vector");
  EXPECT_EQ(size, 4);
  EXPECT_EQ(references(vector.get()), 1);
}

TEST(Check, SaysWhatWasAttempted) {
  EXPECT_NO_THROW(latin::algebra::check(PETSC_SUCCESS, "breathe"));
  const std::string text = message<latin::NumericalError>(
      [] { latin::algebra::check(PETSC_ERR_MEM, "factorise 'cover'"); });
  EXPECT_NE(text.find("could not factorise 'cover'"), std::string::npos) << text;
  EXPECT_NE(text.find(std::to_string(static_cast<int>(PETSC_ERR_MEM))), std::string::npos) << text;
}

TEST(ToSparse, CopiesWithoutExplicitZeros) {
  const MatHandle matrix = MatHandle::adopt(example(3.0));
  const latin::SparseRows copy = latin::algebra::to_sparse(matrix.get(), "cover");
  EXPECT_EQ(references(matrix.get()), 1);
  EXPECT_EQ(copy.rows(), 2);
  EXPECT_EQ(copy.cols(), 3);
  EXPECT_EQ(copy.nonZeros(), 3);
  EXPECT_EQ(latin::Matrix(copy), (latin::Matrix(2, 3) << 1.0, 0.0, 0.0, 0.0, 2.0, 3.0).finished());
  // a copy: the matrix may change afterwards
  latin::algebra::check(MatScale(matrix.get(), -1.0), "scale");
  EXPECT_EQ(copy.coeff(0, 0), 1.0);
}

TEST(ToSparse, AcceptsAMatrixWithoutEntries) {
  MatHandle matrix;
  latin::algebra::check(MatCreateSeqAIJ(PETSC_COMM_SELF, 3, 2, 0, nullptr, matrix.out()), "create");
  latin::algebra::check(MatAssemblyBegin(matrix.get(), MAT_FINAL_ASSEMBLY), "assemble");
  latin::algebra::check(MatAssemblyEnd(matrix.get(), MAT_FINAL_ASSEMBLY), "assemble");
  const latin::SparseRows copy = latin::algebra::to_sparse(matrix.get(), "void");
  EXPECT_EQ(copy.rows(), 3);
  EXPECT_EQ(copy.nonZeros(), 0);
}

TEST(ToSparse, RefusesWhatIsNotANumber) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    const MatHandle matrix = MatHandle::adopt(example(bad));
    const std::string text = message<latin::InputError>(
        [&matrix] { static_cast<void>(latin::algebra::to_sparse(matrix.get(), "cover")); });
    EXPECT_NE(text.find("'cover' holds a NaN or infinity in row 1"), std::string::npos) << text;
    // the row was given back: the matrix can still be read
    PetscScalar value = 0.0;
    latin::algebra::check(MatGetValue(matrix.get(), 0, 0, &value), "read a value");
    EXPECT_EQ(value, 1.0);
    EXPECT_EQ(references(matrix.get()), 1);
  }
}
