#pragma once

#include <vector>

#include "videogrammetry/geometry/rig.h"
#include "videogrammetry/rendering/background.h"
#include "videogrammetry/rendering/fine_window.h"
#include "videogrammetry/rendering/scene.h"

namespace videogrammetry {

/// Longest way of a target's point in the picture during one exposure.
inline constexpr double kMaxBlurPx = 200.0;
/// Positions of a moving target over the exposure, at least; more where the way
/// between two of them would exceed a quarter of a pixel.
inline constexpr int kMinBlurPositions = 8;

/// Paints a target's cells; an empty window where nothing of it is in the picture.
///
/// A moving target is the mean of positions at the middles of equal parts of the
/// exposure: a chord of n positions has (1 - 1/n^2) of the box's variance.
/// @throws std::invalid_argument if a point moves by more than kMaxBlurPx.
FineWindow PaintTarget(const OrientedCamera& camera, const SceneTarget& target,
                       const LightField& light, const PsfKernel& psf);

/// Puts targets before the background and through the lens: from far to near by
/// the centre's depth, each hiding what is behind it.
///
/// @param raw  the background before the lens. @param picture  the background
///     behind it on entry, the whole picture on return.
void Compose(const std::vector<FineWindow>& far_to_near, const std::vector<float>& raw,
             const PsfKernel& psf, int width, int height, float* picture);

}  // namespace videogrammetry
