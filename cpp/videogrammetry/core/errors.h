#pragma once

#include <stdexcept>
#include <string>

namespace videogrammetry {

/// The task as a whole failed although the arguments were valid: the message
/// gives the cause, the numbers and the remedy. The caller's own mistakes are
/// std::invalid_argument; one item's failure is a std::optional or a status.
class TaskError : public std::runtime_error {
 public:
  explicit TaskError(const std::string& what) : std::runtime_error(what) {}
};

/// An adjustment has no unique or no trustworthy solution.
class AdjustmentError : public TaskError {
 public:
  using TaskError::TaskError;
};

}  // namespace videogrammetry
