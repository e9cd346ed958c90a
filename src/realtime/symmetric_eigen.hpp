#pragma once

#include <Eigen/Core>

namespace realtime {

// A = V diag(values) V^T of a symmetric matrix, for N of 6 and 7. Eigen's, compiled once.
template <int N>
struct SymmetricEigen {
  explicit SymmetricEigen(const Eigen::Matrix<double, N, N>& A) noexcept;

  Eigen::Matrix<double, N, 1> values;   // rising
  Eigen::Matrix<double, N, N> vectors;  // as columns, of length 1
};

}  // namespace realtime
