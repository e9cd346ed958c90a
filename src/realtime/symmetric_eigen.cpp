#include "realtime/symmetric_eigen.hpp"

#include <Eigen/Eigenvalues>

namespace realtime {

template <int N>
SymmetricEigen<N>::SymmetricEigen(const Eigen::Matrix<double, N, N>& A) noexcept {
  // One solver for both sizes, as it takes long to compile. It does not allocate.
  using UpTo7 = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 7, 7>;
  const Eigen::SelfAdjointEigenSolver<UpTo7> solver{UpTo7(A)};
  values = solver.eigenvalues();
  vectors = solver.eigenvectors();
}

template struct SymmetricEigen<6>;
template struct SymmetricEigen<7>;

}  // namespace realtime
