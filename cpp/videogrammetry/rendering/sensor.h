#pragma once

#include <cstdint>

#include "videogrammetry/rendering/scene.h"

namespace videogrammetry {

/// Reads a picture of light (shares of full scale) out as samples.
///
/// grey = round(light * full_scale + sigma n), clipped to 0 ... full_scale, with
/// sigma^2 = read_noise^2 + shot_noise_gain * light * full_scale and n standard
/// normal, a function of (seed, pixel's index) alone. n is the inverse normal
/// distribution of 32 bits: linear between 4096 quantiles (to 1e-3), and by
/// Acklam's rational function (relative error 1.2e-9) in the 16 outer cells.
///
/// @tparam T  std::uint8_t (bit_depth 8) or std::uint16_t.
template <typename T>
void ReadOut(const float* light, std::size_t count, const Sensor& sensor, std::uint64_t seed,
             T* samples);

/// The n of pixel `index`.
float StandardNormal(std::uint64_t seed, std::size_t index);

}  // namespace videogrammetry
