#include "server/path_pace.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/tick.hpp"

namespace server {
namespace {

using realtime::Vector7;

constexpr double kMost = 0.95;       // of the limits of acceleration, for the path and its pace together
constexpr double kForPace = 0.1;     // of them that a change of pace may always use
constexpr double kSmoothing = 0.02;  // s of the path, over which the rate is smoothed, to either side
constexpr std::size_t kLeastSmoothing = 2;  // samples
constexpr double kLeastRate = 1e-3;

// Derivatives by the path's time.
struct Derivatives {
  Vector7 v, a, j;
};

std::vector<Derivatives> derivatives(const std::vector<Vector7>& q, double step) {
  const std::size_t last = q.size() - 1;
  std::vector<Derivatives> out(q.size());
  for (std::size_t k = 0; k <= last; ++k) {
    const std::size_t m = std::clamp<std::size_t>(k, 1, last - 1);
    out[k].v = (q[std::min(k + 1, last)] - q[k == 0 ? 0 : k - 1]) / (step * (k == 0 || k == last ? 1 : 2));
    out[k].a = (q[m + 1] - 2 * q[m] + q[m - 1]) / (step * step);
  }
  for (std::size_t k = 0; k <= last; ++k) {
    const std::size_t m = std::clamp<std::size_t>(k, 1, last - 1);
    out[k].j = (out[m + 1].a - out[m - 1].a) / (2 * step);
  }
  return out;
}

// How fast the square of the rate may change at such a square.
double room(const Derivatives& d, double square, const models::Limits& limits) {
  double least = 1e9;
  for (int i = 0; i < models::kJoints; ++i) {
    const double left = std::max(kMost * limits.ddq_max[i] - std::abs(d.a[i]) * square, kForPace * limits.ddq_max[i]);
    least = std::min(least, left / std::max(std::abs(d.v[i]), 1e-9));
  }
  return 2 * least;
}

// The least within `width` to either side (at most all there is), averaged twice over half of that: nowhere above what it was.
std::vector<double> smoothed(const std::vector<double>& x, std::size_t width) {
  const auto window = [&](const std::vector<double>& from, std::size_t half, auto reduce) {
    std::vector<double> out(from.size());
    for (std::size_t k = 0; k < from.size(); ++k) {
      const auto at = [&](std::ptrdiff_t i) {
        return from[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, static_cast<std::ptrdiff_t>(from.size()) - 1))];
      };
      out[k] = reduce(at, static_cast<std::ptrdiff_t>(k), static_cast<std::ptrdiff_t>(half));
    }
    return out;
  };
  const auto least = [](const auto& at, std::ptrdiff_t k, std::ptrdiff_t half) {
    double value = at(k);
    for (std::ptrdiff_t i = k - half; i <= k + half; ++i) value = std::min(value, at(i));
    return value;
  };
  const auto mean = [](const auto& at, std::ptrdiff_t k, std::ptrdiff_t half) {
    double sum = 0;
    for (std::ptrdiff_t i = k - half; i <= k + half; ++i) sum += at(i);
    return sum / static_cast<double>(2 * half + 1);
  };
  const std::size_t half = (width + 1) / 2;
  return window(window(window(x, 2 * half, least), half, mean), half, mean);
}

}  // namespace

std::optional<realtime::Pace> pace_along(const SampledWay& way, const models::Limits& limits, double share) {
  if (way.duration < realtime::kTick) return std::nullopt;
  const std::size_t last = way.q.size() - 1;
  const double step = way.duration / static_cast<double>(last);
  const std::vector<Derivatives> d = derivatives(way.q, step);
  std::vector<double> square(way.q.size());
  for (std::size_t k = 0; k <= last; ++k) {
    double rate = std::min(way.rate[k], 1.);
    for (int i = 0; i < models::kJoints; ++i) {
      rate = std::min({rate, std::sqrt(share * limits.ddq_max[i] / std::max(std::abs(d[k].a[i]), 1e-9)),
                       std::cbrt(share * limits.dddq_max[i] / std::max(std::abs(d[k].j[i]), 1e-9))});
    }
    square[k] = std::pow(std::max(rate, kLeastRate), 2);
  }
  if (*std::min_element(square.begin(), square.end()) >= 1) return std::nullopt;
  for (std::size_t k = 1; k <= last; ++k) {
    square[k] = std::min(square[k], square[k - 1] + step * room(d[k - 1], square[k - 1], limits));
  }
  for (std::size_t k = last; k > 0; --k) {
    square[k - 1] = std::min(square[k - 1], square[k] + step * room(d[k], square[k], limits));
  }
  std::vector<double> rate(square.size());
  std::transform(square.begin(), square.end(), rate.begin(), [](double x) { return std::sqrt(x); });
  rate = smoothed(rate, std::clamp(static_cast<std::size_t>(std::lround(kSmoothing / step)), kLeastSmoothing, last));

  realtime::Pace pace;
  for (std::size_t k = 0; k <= last; ++k) {
    const double time = k == 0 ? 0 : pace.places.back().time + 2 * step / (rate[k - 1] + rate[k]);
    const double slope = (rate[std::min(k + 1, last)] - rate[k == 0 ? 0 : k - 1]) / (2 * step);
    pace.places.push_back({time, step * static_cast<double>(k), rate[k], rate[k] * (k == 0 || k == last ? 0 : slope)});
  }
  return pace;
}

}  // namespace server
