#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "videogrammetry/recognition/options.h"

namespace videogrammetry {

/// Codes of up to this many bits fit.
inline constexpr int kMaxCodeBits = 24;

/// Smallest cyclic rotation of the lower num_bits bits: a code's name however
/// the target is turned.
std::uint32_t CanonicalCode(std::uint32_t code, int num_bits);

/// The bits in reverse order: the code read in the other direction.
std::uint32_t ReversedCode(std::uint32_t code, int num_bits);

/// A family of ring codes: the ring around the dot is divided into num_bits
/// equal sectors, bright (1) or dark (0), read one way round, most significant
/// bit first; the code is the smallest of its rotations.
struct CodeFamily {
  std::string name = "none";
  int num_bits = 0;         ///< 0: no codes
  double ring_inner = 2.0;  ///< radii of the ring in radii of the dot
  double ring_outer = 3.0;
  std::vector<std::uint32_t> codes;  ///< canonical; the i-th has the ID i + 1

  /// Number of a canonical code, from 1.
  std::optional<int> IdOf(std::uint32_t canonical_code) const;

  /// Costs nothing: Index() has looked at the codes.
  /// @throws std::invalid_argument naming what is wrong: bits not in 4 ... 24,
  ///   radii not 1 < inner < outer <= 10, a code not canonical, all dark or all
  ///   bright, or given twice (with both IDs).
  void Check() const;

  /// Fills the look-up table and checks the codes, after `num_bits` or `codes` has changed.
  void Index();

 private:
  std::string CodesFault() const;

  std::unordered_map<std::uint32_t, int> id_of_;
  int indexed_bits_ = 0;
  std::string fault_;
};

/// The first two IDs whose codes are one sector apart in some rotation: where one
/// wrongly read sector turns one ID into another. nullopt: the codes' minimum cyclic
/// distance is 2 or more.
std::optional<std::pair<int, int>> OneSectorApart(const CodeFamily& family);

/// Schneider's (AICON's, PhotoModeler's) rule: canonical codes in ascending
/// order with even parity, at least one pair of opposite ones, not all ones;
/// ring from 2 to 3 radii (DE19733466A1).
/// @param num_bits  even, 4 ... 20.
CodeFamily SchneiderFamily(int num_bits);

/// Metashape's circular targets: canonical codes in ascending order with even
/// parity, at least four ones, the longest run of zeros shorter than half the
/// ring, not all ones; ring from 2.25 to 3.5 radii.
CodeFamily MetashapeFamily(int num_bits);

/// A family by its name: "none", "schneider-8", -10, -12, -14, -16, -20,
/// "metashape-12", -14.
/// @throws std::invalid_argument with the list of names.
CodeFamily NamedCodeFamily(const std::string& name);

/// The names of the families.
const std::vector<std::string>& CodeFamilyNames();

}  // namespace videogrammetry
