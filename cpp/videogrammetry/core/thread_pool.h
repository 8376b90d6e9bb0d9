#pragma once

#include <functional>

namespace videogrammetry {

/// Number of threads that `num_threads` asks for: itself, or every core for 0.
/// @throws std::invalid_argument if num_threads < 0.
int ResolveThreads(int num_threads);

/// Calls body(i) for every i in [0, count), on up to `num_threads` threads.
///
/// Indices are handed out one by one, so uneven items balance. The result must
/// not depend on which thread runs which index: body writes to its own slot.
/// The first exception (of the lowest index among those that threw) is thrown
/// again here after all threads have stopped; indices not yet begun are skipped.
///
/// @param num_threads  0: one a core; 1: no thread is started.
void ParallelFor(int count, int num_threads, const std::function<void(int)>& body);

}  // namespace videogrammetry
