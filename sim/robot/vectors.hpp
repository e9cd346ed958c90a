#pragma once

#include <Eigen/Core>
#include <array>

namespace sim {

// Between the arrays of the wire and Eigen.

template <std::size_t N>
Eigen::Map<const Eigen::Matrix<double, static_cast<int>(N), 1>> vector(const std::array<double, N>& values) {
  return Eigen::Map<const Eigen::Matrix<double, static_cast<int>(N), 1>>(values.data());
}

template <class Matrix, std::size_t N>
void put(const Matrix& from, std::array<double, N>& to) {
  Eigen::Map<Eigen::Matrix<double, Matrix::RowsAtCompileTime, Matrix::ColsAtCompileTime>>(to.data()) = from;
}

}  // namespace sim
