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
      over_[j] = 1 / L_(j, j);
      for (int i = j + 1; i < N; ++i) {
        double s = A(i, j);
        for (int k = 0; k < j; ++k) s -= L_(i, k) * L_(j, k);
        L_(i, j) = s * over_[j];
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
      x[i] = s * over_[i];
    }
    return x;
  }

  // L^-T b
  Vector solve_Lt(const Vector& b) const noexcept {
    Vector x;
    for (int i = N - 1; i >= 0; --i) {
      double s = b[i];
      for (int k = i + 1; k < N; ++k) s -= L_(k, i) * x[k];
      x[i] = s * over_[i];
    }
    return x;
  }

  // A^-1 B, all columns side by side.
  template <int Columns>
  Eigen::Matrix<double, N, Columns> solve(const Eigen::Matrix<double, N, Columns>& B) const noexcept {
    Eigen::Matrix<double, N, Columns, Columns == 1 ? Eigen::ColMajor : Eigen::RowMajor> X = B;
    for (int i = 0; i < N; ++i) {
      for (int k = 0; k < i; ++k) X.row(i) -= L_(i, k) * X.row(k);
      X.row(i) *= over_[i];
    }
    for (int i = N - 1; i >= 0; --i) {
      for (int k = i + 1; k < N; ++k) X.row(i) -= L_(k, i) * X.row(k);
      X.row(i) *= over_[i];
    }
    return X;
  }

  Matrix inverse() const noexcept { return solve<N>(Matrix::Identity()); }

 private:
  Matrix L_ = Matrix::Zero();
  Vector over_;  // 1 by the diagonal of L: dividing takes many times as long as multiplying
};

}  // namespace realtime
