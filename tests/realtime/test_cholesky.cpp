#include <gtest/gtest.h>

#include "realtime/cholesky.hpp"
#include "realtime/symmetric_eigen.hpp"

namespace realtime {
namespace {

constexpr int N = 6;
using Matrix = Eigen::Matrix<double, N, N>;
using Vector = Eigen::Matrix<double, N, 1>;

class Random : public testing::TestWithParam<int> {
 protected:
  Random() {
    std::srand(GetParam());
    const Matrix half = Matrix::Random();
    A = half * half.transpose() + 0.01 * Matrix::Identity();
    b = Vector::Random();
  }
  Matrix A;
  Vector b;
};

INSTANTIATE_TEST_SUITE_P(Matrices, Random, testing::Range(1, 6));

TEST_P(Random, CholeskyFactorsMakeTheMatrix) {
  const Cholesky<N> factors(A);
  EXPECT_LT((factors.L() * factors.L().transpose() - A).norm(), 1e-14 * A.norm());
  EXPECT_TRUE(factors.L().isLowerTriangular(0));
}

TEST_P(Random, CholeskySolves) {
  const Cholesky<N> factors(A);
  EXPECT_LT((A * factors.solve(b) - b).norm(), 1e-10);
  EXPECT_LT((factors.L() * factors.solve_L(b) - b).norm(), 1e-12);
  EXPECT_LT((factors.L().transpose() * factors.solve_Lt(b) - b).norm(), 1e-12);
  EXPECT_LT((A * factors.inverse() - Matrix::Identity()).norm(), 1e-10);
}

TEST_P(Random, EigenvectorsDiagonalise) {
  const SymmetricEigen<N> eigen(A);
  EXPECT_LT((A * eigen.vectors - eigen.vectors * eigen.values.asDiagonal()).norm(), 1e-12);
  EXPECT_LT((eigen.vectors.transpose() * eigen.vectors - Matrix::Identity()).norm(), 1e-12);
}

TEST(Cholesky, OfAnIndefiniteMatrixIsNotFinite) {
  EXPECT_FALSE(Cholesky<2>((Eigen::Matrix2d() << 1, 2, 2, 1).finished()).L().allFinite());
}

}  // namespace
}  // namespace realtime
