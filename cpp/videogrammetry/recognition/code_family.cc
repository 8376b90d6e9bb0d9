#include "videogrammetry/recognition/code_family.h"

#include <algorithm>
#include <bit>
#include <stdexcept>

namespace videogrammetry {
namespace {

std::uint32_t AllOnes(int num_bits) { return (std::uint32_t{1} << num_bits) - 1; }

std::uint32_t Rotated(std::uint32_t code, int num_bits) {
  return ((code << 1) & AllOnes(num_bits)) | (code >> (num_bits - 1));
}

bool HasOppositeOnes(std::uint32_t code, int num_bits) {
  return (code & (code >> (num_bits / 2)) & AllOnes(num_bits / 2)) != 0;
}

int LongestRunOfZeros(std::uint32_t code, int num_bits) {
  int run = 0, longest = 0;
  for (int i = 0; i < 2 * num_bits; ++i) {
    run = ((code >> (i % num_bits)) & 1) == 0 ? run + 1 : 0;
    longest = std::max(longest, run);
  }
  return std::min(longest, num_bits);
}

/// Canonical codes of even parity, not all ones, that obey `rule`, ascending.
template <typename Rule>
std::vector<std::uint32_t> CodesObeying(int num_bits, Rule&& rule) {
  std::vector<std::uint32_t> codes;
  for (std::uint32_t code = 1; code < AllOnes(num_bits); ++code) {
    if (std::popcount(code) % 2 == 0 && rule(code) && CanonicalCode(code, num_bits) == code) {
      codes.push_back(code);
    }
  }
  return codes;
}

CodeFamily Family(const std::string& kind, int num_bits, double inner, double outer,
                  std::vector<std::uint32_t> codes) {
  CodeFamily family;
  family.name = kind + "-" + std::to_string(num_bits);
  family.num_bits = num_bits;
  family.ring_inner = inner;
  family.ring_outer = outer;
  family.codes = std::move(codes);
  family.Index();
  return family;
}

}  // namespace

std::uint32_t CanonicalCode(std::uint32_t code, int num_bits) {
  std::uint32_t smallest = code;
  for (int i = 1; i < num_bits; ++i) {
    code = Rotated(code, num_bits);
    smallest = std::min(smallest, code);
  }
  return smallest;
}

std::uint32_t ReversedCode(std::uint32_t code, int num_bits) {
  std::uint32_t reversed = 0;
  for (int i = 0; i < num_bits; ++i) reversed |= ((code >> i) & 1) << (num_bits - 1 - i);
  return reversed;
}

std::optional<int> CodeFamily::IdOf(std::uint32_t canonical_code) const {
  const auto found = id_of_.find(canonical_code);
  if (found == id_of_.end()) return std::nullopt;
  return found->second;
}

void CodeFamily::Index() {
  id_of_.clear();
  id_of_.reserve(codes.size());
  for (std::size_t i = 0; i < codes.size(); ++i) {
    id_of_.emplace(codes[i], static_cast<int>(i) + 1);
  }
  indexed_bits_ = num_bits;
  fault_ = num_bits >= 4 && num_bits <= kMaxCodeBits ? CodesFault() : "";
}

std::string CodeFamily::CodesFault() const {
  for (std::size_t i = 0; i < codes.size(); ++i) {
    const int id = static_cast<int>(i) + 1;
    const std::string code = std::to_string(codes[i]) + " (ID " + std::to_string(id) + ")";
    if (codes[i] > AllOnes(num_bits) || CanonicalCode(codes[i], num_bits) != codes[i]) {
      return "codes: " + code + " is not the smallest rotation of " + std::to_string(num_bits) +
             " bits";
    }
    if (codes[i] == 0 || codes[i] == AllOnes(num_bits)) {
      return "codes: " + code + " has no border between bright and dark to find its sectors by";
    }
    const int first = id_of_.at(codes[i]);
    if (first != id) {
      return "codes: IDs " + std::to_string(first) + " and " + std::to_string(id) +
             " are the same code or rotations of one (" + std::to_string(codes[i]) +
             "): one is given twice";
    }
  }
  return "";
}

void CodeFamily::Check() const {
  if (num_bits == 0 && codes.empty()) return;
  if (num_bits < 4 || num_bits > kMaxCodeBits) {
    throw std::invalid_argument("bits: expected 4 ... 24, got " + std::to_string(num_bits));
  }
  if (!(ring_inner > 1.0) || !(ring_outer > ring_inner) || !(ring_outer <= 10.0)) {
    throw std::invalid_argument("ring: expected 1 < inner < outer <= 10 radii of the dot, got " +
                                std::to_string(ring_inner) + " and " + std::to_string(ring_outer));
  }
  if (codes.empty()) throw std::invalid_argument("codes: expected at least one, got none");
  if (!fault_.empty()) throw std::invalid_argument(fault_);
  if (indexed_bits_ != num_bits || id_of_.size() != codes.size()) {
    throw std::invalid_argument("codes: changed since Index() was called");
  }
}

std::optional<std::pair<int, int>> OneSectorApart(const CodeFamily& family) {
  for (std::size_t i = 0; i < family.codes.size(); ++i) {
    for (int bit = 0; bit < family.num_bits; ++bit) {
      const std::uint32_t other = family.codes[i] ^ (std::uint32_t{1} << bit);
      const auto id = family.IdOf(CanonicalCode(other, family.num_bits));
      if (id) return std::pair(static_cast<int>(i) + 1, *id);
    }
  }
  return std::nullopt;
}

CodeFamily SchneiderFamily(int num_bits) {
  if (num_bits < 4 || num_bits > 20 || num_bits % 2 != 0) {
    throw std::invalid_argument("num_bits: expected an even number 4 ... 20, got " +
                                std::to_string(num_bits));
  }
  return Family("schneider", num_bits, 2.0, 3.0, CodesObeying(num_bits, [&](std::uint32_t code) {
                  return HasOppositeOnes(code, num_bits);
                }));
}

CodeFamily MetashapeFamily(int num_bits) {
  if (num_bits < 8 || num_bits > 20) {
    throw std::invalid_argument("num_bits: expected 8 ... 20, got " + std::to_string(num_bits));
  }
  return Family("metashape", num_bits, 2.25, 3.5, CodesObeying(num_bits, [&](std::uint32_t code) {
                  return std::popcount(code) >= 4 &&
                         2 * LongestRunOfZeros(code, num_bits) < num_bits;
                }));
}

const std::vector<std::string>& CodeFamilyNames() {
  static const std::vector<std::string> names = {"none",         "schneider-8",  "schneider-10",
                                                 "schneider-12", "schneider-14", "schneider-16",
                                                 "schneider-20", "metashape-12", "metashape-14"};
  return names;
}

CodeFamily NamedCodeFamily(const std::string& name) {
  const auto& names = CodeFamilyNames();
  if (std::find(names.begin(), names.end(), name) == names.end()) {
    std::string all;
    for (const std::string& n : names) all += (all.empty() ? "" : ", ") + n;
    throw std::invalid_argument("codes: expected one of " + all + ", got '" + name + "'");
  }
  if (name == "none") return {};
  const std::size_t dash = name.find('-');
  const int num_bits = std::stoi(name.substr(dash + 1));
  return name.starts_with("schneider") ? SchneiderFamily(num_bits) : MetashapeFamily(num_bits);
}

}  // namespace videogrammetry
