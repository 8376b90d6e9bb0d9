// Recognition of any picture with any options: it ends, touches no memory but
// the picture's, refuses wrong options by std::invalid_argument, and what it
// returns are ellipses with covariances.
//
// Bytes of an input, missing ones being 0:
//    0     format: 8 bit, 16 bit, packed 12 bit high first or low first
//    1 - 4 width and height, little-endian; cut to kMostPixels
//    5     bit 0 polarity, 1 direction, 2-3 estimator, 4-6 codes
//    6     method
//    7 - 8 smallest and largest diameter, quarters of pixels and pixels
//    9     samples between rows (8 and 16 bit), and the drawn picture's ground
//   10     bit 0: the rest are drawing commands of 8 bytes, or else samples, repeated
//   11     amplitude of noise
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "videogrammetry/recognition/recognize.h"

namespace videogrammetry {
namespace {

constexpr std::size_t kHeader = 12, kCommand = 8;
constexpr int kMostPixels = 1 << 15;
constexpr const char* kMethods[] = {"local-canny", "edge-pair"};
constexpr const char* kCodes[] = {"none",         "schneider-8",  "schneider-10", "schneider-12",
                                  "schneider-14", "metashape-12", "metashape-14", "none"};

struct Bytes {
  const std::uint8_t* data;
  std::size_t size;
  int operator[](std::size_t i) const { return i < size ? data[i] : 0; }
};

[[noreturn]] void Fail(const char* what, const Target& target) {
  const Ellipse& e = target.edge.ellipse;
  std::fprintf(stderr, "recognition_fuzz: %s: ellipse %g %g %g %g %g\n", what, e.x_px, e.y_px,
               e.semi_major_px, e.semi_minor_px, e.angle_rad);
  std::abort();
}

/// A blurred ellipse, perhaps with a ring of one of the family's codes, over what is there.
void Draw(const Bytes& bytes, std::size_t at, const CodeFamily& family, int width, int height,
          std::vector<double>* grey) {
  const double x = bytes[at] / 255.0 * width, y = bytes[at + 1] / 255.0 * height;
  const double a = 1.0 + bytes[at + 2] / 6.0, b = a * (0.2 + 0.8 * bytes[at + 3] / 255.0);
  const double angle = bytes[at + 4] / 255.0 * 3.14159265358979, value = bytes[at + 5] / 255.0;
  const int n = bytes[at + 6] == 0 ? 0 : family.num_bits;
  const std::uint32_t code =
      n == 0 ? 0 : family.codes[static_cast<std::size_t>(bytes[at + 6] * 7) % family.codes.size()];
  const double blur = 0.1 + bytes[at + 7] / 100.0, c = std::cos(angle), s = std::sin(angle);
  const double reach = (n > 0 ? family.ring_outer : 1.0) * a + 4 * blur;
  const double middle = 0.5 * (family.ring_inner + family.ring_outer);
  const double half = 0.5 * (family.ring_outer - family.ring_inner);
  for (int j = std::max(0, static_cast<int>(y - reach)); j < std::min<double>(height, y + reach);
       ++j) {
    for (int i = std::max(0, static_cast<int>(x - reach)); i < std::min<double>(width, x + reach);
         ++i) {
      const double u = (c * (i - x) + s * (j - y)) / a, v = (-s * (i - x) + c * (j - y)) / b;
      const double radius = std::hypot(u, v);
      double out = (radius - 1.0) * b;
      const int sector = static_cast<int>((std::atan2(v, u) + 3.1415926) / 6.2831854 * n);
      if (n > 0 && radius > 1.5 && ((code >> (n - 1 - sector)) & 1) != 0) {
        out = (std::abs(radius - middle) - half) * b;
      }
      double& pixel = (*grey)[static_cast<std::size_t>(j) * static_cast<std::size_t>(width) +
                              static_cast<std::size_t>(i)];
      pixel += (value - pixel) * 0.5 * std::erfc(out / blur);
    }
  }
}

/// Samples of `full` at most, in rows without gaps.
std::vector<std::uint16_t> Samples(const Bytes& bytes, const CodeFamily& family, int width,
                                   int height, int full) {
  const auto count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<std::uint16_t> samples(count);
  if ((bytes[10] & 1) == 0) {
    const std::size_t rest = bytes.size > kHeader ? bytes.size - kHeader : 0;
    for (std::size_t i = 0; i < count && rest > 0; ++i) {
      const int value = bytes[kHeader + i % rest] | bytes[kHeader + (i + 1) % rest] << 8;
      samples[i] = static_cast<std::uint16_t>(value & full);
    }
    return samples;
  }
  std::vector<double> grey(count, bytes[9] / 255.0);
  for (std::size_t at = kHeader; at + kCommand <= bytes.size; at += kCommand) {
    Draw(bytes, at, family, width, height, &grey);
  }
  std::uint32_t state = 12345;
  for (std::size_t i = 0; i < count; ++i) {
    state = state * 1664525u + 1013904223u;
    const double noise = (state >> 8) / 16777216.0 - 0.5;
    const double value = full * (grey[i] + noise * bytes[11] / 512.0);
    samples[i] = static_cast<std::uint16_t>(std::clamp(value, 0.0, 1.0 * full));
  }
  return samples;
}

RecognitionOptions OptionsOf(const Bytes& bytes) {
  RecognitionOptions options;
  options.polarity = bytes[5] & 1 ? Polarity::kBlackOnWhite : Polarity::kWhiteOnBlack;
  options.direction =
      bytes[5] & 2 ? ReadingDirection::kCounterClockwise : ReadingDirection::kClockwise;
  constexpr Estimator kEstimators[] = {Estimator::kMeanGradient, Estimator::kDualConic,
                                       Estimator::kModel, Estimator::kOfMethod};
  options.estimator = kEstimators[bytes[5] >> 2 & 3];
  options.codes = kCodes[bytes[5] >> 4 & 7];
  options.method = kMethods[static_cast<std::size_t>(bytes[6]) % std::size(kMethods)];
  options.diameter_px = {bytes[7] / 4.0, 8.0 * bytes[8]};
  return options;
}

void CheckTargets(const std::vector<Target>& targets, int width, int height) {
  for (const Target& target : targets) {
    const Ellipse& e = target.edge.ellipse;
    if (!(e.semi_minor_px > 0) || !(e.semi_major_px >= e.semi_minor_px) ||
        !std::isfinite(e.semi_major_px) || !(e.angle_rad >= 0) || !(e.angle_rad < 3.1416)) {
      Fail("no ellipse", target);
    }
    if (!(e.x_px > 0) || !(e.y_px > 0) || !(e.x_px < width - 1) || !(e.y_px < height - 1)) {
      Fail("outside the picture", target);
    }
    if (!target.edge.cov.allFinite() || !(target.edge.cov.diagonal().minCoeff() > 0)) {
      Fail("no covariance", target);
    }
    if (!(target.edge.inside > target.edge.outside)) Fail("of the other polarity", target);
  }
}

/// A copy of exactly `size` bytes on the heap, where the sanitizer sees every step beyond it.
template <typename T>
std::unique_ptr<T[]> Exactly(const std::vector<T>& values) {
  auto copy = std::make_unique<T[]>(values.size());
  std::copy(values.begin(), values.end(), copy.get());
  return copy;
}

template <typename T>
std::vector<Target> RecognizeSamples(const std::vector<std::uint16_t>& samples, int width,
                                     int height, int gap, const RecognitionOptions& options,
                                     const CodeFamily& family) {
  const std::size_t stride = static_cast<std::size_t>(width + gap);
  const auto rows = static_cast<std::size_t>(height), columns = static_cast<std::size_t>(width);
  // The last row ends with its last sample.
  std::vector<T> values(rows == 0 ? 0 : (rows - 1) * stride + columns);
  for (std::size_t y = 0; y < rows; ++y) {
    for (std::size_t x = 0; x < columns; ++x) {
      values[y * stride + x] = static_cast<T>(samples[y * columns + x]);
    }
  }
  const auto exact = Exactly(values);
  const ImageView<T> view(exact.get(), width, height, static_cast<std::ptrdiff_t>(stride));
  return Recognize(view, options, family);
}

std::vector<Target> RecognizePacked(const std::vector<std::uint16_t>& samples, int width,
                                    int height, PackedOrder order,
                                    const RecognitionOptions& options, const CodeFamily& family) {
  std::vector<std::uint8_t> packed;
  for (std::size_t i = 0; i + 1 < samples.size(); i += 2) {
    const int a = samples[i], b = samples[i + 1];
    const bool high = order == PackedOrder::kHighFirst;
    packed.push_back(static_cast<std::uint8_t>(high ? a >> 4 : a));
    packed.push_back(
        static_cast<std::uint8_t>(high ? (a & 15) << 4 | b >> 8 : a >> 8 | (b & 15) << 4));
    packed.push_back(static_cast<std::uint8_t>(high ? b : b >> 4));
  }
  const auto exact = Exactly(packed);
  const Packed12View view(exact.get(), width, height, order);
  return Recognize(view, options, family);
}

void RunOne(const Bytes& bytes) {
  const int format = bytes[0] & 3;
  int width = bytes[1] | bytes[2] << 8, height = bytes[3] | bytes[4] << 8;
  if (format >= 2) width &= ~1;
  height = std::min(height, kMostPixels / std::max(1, width));
  const RecognitionOptions options = OptionsOf(bytes);
  constexpr int kFull[] = {255, 65535, 4095, 4095};
  const CodeFamily family = NamedCodeFamily(options.codes);
  const auto samples = Samples(bytes, family, width, height, kFull[format]);
  std::vector<Target> targets;
  try {
    if (format == 0) {
      targets = RecognizeSamples<std::uint8_t>(samples, width, height, bytes[9], options, family);
    } else if (format == 1) {
      targets = RecognizeSamples<std::uint16_t>(samples, width, height, bytes[9], options, family);
    } else {
      const auto order = format == 2 ? PackedOrder::kHighFirst : PackedOrder::kLowFirst;
      targets = RecognizePacked(samples, width, height, order, options, family);
    }
  } catch (const std::invalid_argument&) {
    return;  // options that nobody can mean
  }
  CheckTargets(targets, width, height);
}

}  // namespace
}  // namespace videogrammetry

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  videogrammetry::RunOne({data, size});
  return 0;
}
