#pragma once

#include <Eigen/Core>
#include <cmath>

namespace realtime {

// A = L L^T of a symmetric positive definite matrix (Golub, Van Loan, Matrix Computations, 4.2.5), in plain loops: a loop
// that wakes once a millisecond reads its code from memory each time, and Eigen's, unrolled, is many times as long.
template <int N>
class Cholesky {
 public:
  using Matrix = Eigen::Matrix<double, N, N>;
  using Vector = Eigen::Matrix<double, N, 1>;

  // Of a matrix that is not positive definite the factor is not finite.
  explicit Cholesky(const Matrix& A) noexcept {
    for (int j = 0; j < N; ++j) {
      double d = A(j, j);
      for (int k = 0; k < j; ++k) d -= L_(j, k) * L_(j, k);
      L_(j, j) = std::sqrt(d);
      for (int i = j + 1; i < N; ++i) {
        double s = A(i, j);
        for (int k = 0; k < j; ++k) s -= L_(i, k) * L_(j, k);
        L_(i, j) = s / L_(j, j);
      }
    }
  }

  const Matrix& L() const noexcept { return L_; }

  // L^-1 b
  Vector solve_L(const Vector& b) const noexcept {
    Vector x;
    for (int i = 0; i < N; ++i) {
      double s = b[i];
      for (int k = 0; k < i; ++k) s -= L_(i, k) * x[k];
      x[i] = s / L_(i, i);
    }
    return x;
  }

  // L^-T b
  Vector solve_Lt(const Vector& b) const noexcept {
    Vector x;
    for (int i = N - 1; i >= 0; --i) {
      double s = b[i];
      for (int k = i + 1; k < N; ++k) s -= L_(k, i) * x[k];
      x[i] = s / L_(i, i);
    }
    return x;
  }

  // A^-1 B, column by column.
  template <int Columns>
  Eigen::Matrix<double, N, Columns> solve(const Eigen::Matrix<double, N, Columns>& B) const noexcept {
    Eigen::Matrix<double, N, Columns> X;
    for (int i = 0; i < Columns; ++i) X.col(i) = solve_Lt(solve_L(B.col(i)));
    return X;
  }

  Matrix inverse() const noexcept { return solve<N>(Matrix::Identity()); }

 private:
  Matrix L_ = Matrix::Zero();
};

}  // namespace realtime
