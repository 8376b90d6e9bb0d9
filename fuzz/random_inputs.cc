// Calls LLVMFuzzerTestOneInput with inputs made at random where there is no
// libFuzzer. No coverage guides them: half of them are pictures that a target
// can lie in, so that every stage is reached, half are arbitrary bytes.
//
//     recognition_fuzz [--seconds S] [--seed N] [--first K] [--runs R] [FILE ...]
//
// Input K of seed N is the same on every machine. What dies says how to run it again.
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
extern "C" void __sanitizer_set_death_callback(void (*callback)()) __attribute__((weak));

namespace {

constexpr unsigned kMostSecondsEach = 60;
constexpr std::size_t kHeader = 12;

unsigned long long current_seed = 0, current_run = 0;
double slowest_s = 0.0;
unsigned long long slowest_run = 0;

void SayWhich() {
  std::fprintf(stderr, "again with: recognition_fuzz --seed %llu --first %llu --runs 1\n",
               current_seed, current_run);
}

void OnSignal(int signal) {
  std::fprintf(stderr, signal == SIGALRM ? "an input took more than %u s\n" : "ended by a signal\n",
               kMostSecondsEach);
  SayWhich();
  _exit(1);
}

std::vector<std::uint8_t> MakeInput(unsigned long long seed, unsigned long long run) {
  std::mt19937_64 random(seed * 0x9e3779b97f4a7c15ull + run);
  // Not std::uniform_int_distribution: it differs between libraries.
  const auto below = [&](unsigned n) { return static_cast<unsigned>((random() >> 11) % n); };
  const bool picture = below(2) == 0;
  const std::size_t size = picture ? kHeader + 8 * (1 + below(8)) : below(2000);
  std::vector<std::uint8_t> bytes(std::max<std::size_t>(size, kHeader));
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(below(256));
  const unsigned width = below(6) == 0 ? below(65536) : below(320), height = below(320);
  bytes[1] = static_cast<std::uint8_t>(width);
  bytes[2] = static_cast<std::uint8_t>(width >> 8);
  bytes[3] = static_cast<std::uint8_t>(height);
  bytes[4] = static_cast<std::uint8_t>(height >> 8);
  if (below(8) != 0) {  // options that are right
    bytes[7] = static_cast<std::uint8_t>(12 + below(20));
    bytes[8] = static_cast<std::uint8_t>(10 + below(30));
  }
  bytes[10] = picture ? 1 : 0;
  if (picture && below(4) != 0) {  // as dots are
    const bool white = (bytes[5] & 1) == 0;
    bytes[7] = static_cast<std::uint8_t>(12 + below(8));
    bytes[9] = static_cast<std::uint8_t>(white ? below(60) : 200 + below(56));
    bytes[11] = static_cast<std::uint8_t>(below(20));
    for (std::size_t at = kHeader; at + 8 <= bytes.size(); at += 8) {
      bytes[at + 2] = static_cast<std::uint8_t>(below(120));
      bytes[at + 3] = static_cast<std::uint8_t>(100 + below(156));
      bytes[at + 5] = static_cast<std::uint8_t>(white ? 120 + below(136) : below(130));
      bytes[at + 7] = static_cast<std::uint8_t>(30 + below(120));
      if (below(2) == 0) bytes[at + 6] = 0;  // no ring
    }
  }
  // Runs of one value among arbitrary samples: edges, plateaus.
  for (unsigned k = picture ? 0 : below(40); k > 0 && size > kHeader + 1; --k) {
    const std::size_t begin = kHeader + below(static_cast<unsigned>(size - kHeader));
    const std::size_t end = std::min(size, begin + below(60));
    const auto value = static_cast<std::uint8_t>(below(2) == 0 ? 255 * below(2) : below(256));
    for (std::size_t i = begin; i < end; ++i) bytes[i] = value;
  }
  bytes.resize(size);
  return bytes;
}

void RunOne(const std::vector<std::uint8_t>& bytes) {
  // An exact copy, so that reading beyond the input is seen.
  const std::vector<std::uint8_t> copy(bytes.begin(), bytes.end());
  const auto begin = std::chrono::steady_clock::now();
  alarm(kMostSecondsEach);
  LLVMFuzzerTestOneInput(copy.data(), copy.size());
  alarm(0);
  const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
  if (taken.count() > slowest_s) {
    slowest_s = taken.count();
    slowest_run = current_run;
  }
}

int RunFile(const char* path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    std::fprintf(stderr, "recognition_fuzz: cannot read %s\n", path);
    return 1;
  }
  RunOne({std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()});
  std::printf("%s: ended\n", path);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  double seconds = 10.0;
  unsigned long long first = 0, runs = ~0ull;
  std::vector<const char*> files;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name.rfind("--", 0) != 0) {
      files.push_back(argv[i]);
      continue;
    }
    const char* value = i + 1 < argc ? argv[++i] : "";
    if (name == "--seconds")
      seconds = std::atof(value);
    else if (name == "--seed")
      current_seed = std::strtoull(value, nullptr, 10);
    else if (name == "--first")
      first = std::strtoull(value, nullptr, 10);
    else if (name == "--runs")
      runs = std::strtoull(value, nullptr, 10);
    else {
      std::fprintf(stderr, "recognition_fuzz: unknown option %s\n", name.c_str());
      return 2;
    }
  }
  if (__sanitizer_set_death_callback != nullptr) __sanitizer_set_death_callback(SayWhich);
  std::signal(SIGABRT, OnSignal);
  std::signal(SIGALRM, OnSignal);
  for (const char* path : files) {
    if (const int failed = RunFile(path)) return failed;
  }
  if (!files.empty()) return 0;
  const auto begin = std::chrono::steady_clock::now();
  unsigned long long done = 0;
  for (current_run = first; done < runs; ++current_run, ++done) {
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - begin;
    if (taken.count() > seconds) break;
    RunOne(MakeInput(current_seed, current_run));
  }
  std::printf("recognition_fuzz: seed %llu: %llu inputs ended; the slowest, %llu, after %.2f s\n",
              current_seed, done, slowest_run, slowest_s);
  return 0;
}
