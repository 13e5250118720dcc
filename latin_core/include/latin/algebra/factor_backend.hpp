#pragma once

namespace latin::algebra {

/// Which library factorises. `automatic` is CHOLMOD where it was built in, else MUMPS through PETSc. CHOLMOD goes to
/// indices of 64 bits by itself where those of 32 cannot count the numbers of a factor; `cholmod64` has them at once.
enum class FactorBackend { automatic, cholmod, cholmod64, mumps };

}  // namespace latin::algebra
