#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace videogrammetry {

/// Set of keys that are well mixed already (SetKey): open addressing, one cache line a look.
class KeySet {
 public:
  explicit KeySet(std::size_t expected = 0) {
    std::size_t size = 64;
    while (size < 2 * expected) size *= 2;
    slots_.assign(size, kEmpty);
  }

  bool contains(std::uint64_t key) const { return slots_[Find(Used(key))] != kEmpty; }

  /// False if it was there.
  bool insert(std::uint64_t key) {
    const std::uint64_t used = Used(key);
    const std::size_t place = Find(used);
    if (slots_[place] != kEmpty) return false;
    slots_[place] = used;
    if (2 * ++count_ > slots_.size()) Grow();
    return true;
  }

 private:
  static constexpr std::uint64_t kEmpty = 0;
  static std::uint64_t Used(std::uint64_t key) { return key == kEmpty ? 1 : key; }

  std::size_t Find(std::uint64_t key) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t place = key & mask;
    while (slots_[place] != kEmpty && slots_[place] != key) place = (place + 1) & mask;
    return place;
  }
  void Grow() {
    std::vector<std::uint64_t> before(2 * slots_.size(), kEmpty);
    before.swap(slots_);
    for (const std::uint64_t key : before) {
      if (key != kEmpty) slots_[Find(key)] = key;
    }
  }

  std::vector<std::uint64_t> slots_;
  std::size_t count_ = 0;
};

}  // namespace videogrammetry
