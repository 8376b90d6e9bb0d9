#include "videogrammetry/adjustment/significance.h"

#include <algorithm>
#include <cmath>

namespace videogrammetry {
namespace {

/// Linear estimates of the cameras' parameters and their covariance.
struct Estimates {
  Eigen::VectorXd value;  // minus the start value
  Eigen::MatrixXd cov;
  std::vector<int> camera, parameter;
  std::vector<bool> out;
};

Estimates CameraEstimates(const Network& network, const Dispersion& dispersion) {
  std::vector<int> place;
  Estimates e;
  for (std::size_t c = 0; c < network.cameras.size(); ++c) {
    for (int k = 0; k < kNumCameraUnknowns; ++k) {
      if (dispersion.index().camera[c][k] < 0) continue;
      place.push_back(dispersion.index().camera[c][k]);
      e.camera.push_back(static_cast<int>(c));
      e.parameter.push_back(k);
    }
  }
  const Eigen::Index n = static_cast<Eigen::Index>(place.size());
  e.value.resize(n);
  e.out.assign(place.size(), false);
  for (Eigen::Index i = 0; i < n; ++i) {
    const NetworkCamera& camera = network.cameras[e.camera[i]];
    e.value[i] = camera.values()[e.parameter[i]] - camera.start[e.parameter[i]];
  }
  e.cov = dispersion.Covariance(place, place);
  return e;
}

bool HigherRadialStays(const Estimates& e, std::size_t i) {
  if (e.parameter[i] != kA1 && e.parameter[i] != kA2) return false;
  for (std::size_t j = 0; j < e.out.size(); ++j) {
    if (!e.out[j] && e.camera[j] == e.camera[i] && e.parameter[j] > e.parameter[i] &&
        e.parameter[j] <= kA3) {
      return true;
    }
  }
  return false;
}

/// Sets what is dropped to its start value, the other unknowns follow.
void HoldAtStart(Network* network, const Dispersion& dispersion,
                 const std::vector<DroppedParameter>& dropped) {
  std::vector<int> which;
  Eigen::VectorXd change(static_cast<Eigen::Index>(dropped.size()));
  for (const DroppedParameter& d : dropped) {
    const NetworkCamera& camera = network->cameras[d.camera];
    change[static_cast<Eigen::Index>(which.size())] =
        camera.start[d.parameter] - camera.values()[d.parameter];
    which.push_back(dispersion.index().camera[d.camera][d.parameter]);
  }
  if (which.empty()) return;
  dispersion.ApplyCondition(which, change, network);
  for (const DroppedParameter& d : dropped) {
    NetworkCamera& camera = network->cameras[d.camera];
    camera.free[d.parameter] = false;
    CameraVector values = camera.values();
    values[d.parameter] = camera.start[d.parameter];
    camera.set_values(values);
  }
}

}  // namespace

std::vector<DroppedParameter> DropInsignificant(Network* network, const Dispersion& dispersion,
                                                const std::vector<CameraMask>& offered,
                                                double sigma0, double critical_value) {
  Estimates e = CameraEstimates(*network, dispersion);
  std::vector<DroppedParameter> dropped;
  while (true) {
    std::size_t weakest = e.out.size();
    double smallest = critical_value;
    for (std::size_t i = 0; i < e.out.size(); ++i) {
      const int k = e.parameter[i];
      if (e.out[i] || k <= kY0 || !offered[e.camera[i]][k] || HigherRadialStays(e, i)) continue;
      const double t = std::abs(e.value[i]) / (sigma0 * std::sqrt(e.cov(i, i)));
      if (t < smallest) {
        smallest = t;
        weakest = i;
      }
    }
    if (weakest == e.out.size()) break;
    const Eigen::Index j = static_cast<Eigen::Index>(weakest);
    dropped.push_back({e.camera[weakest], e.parameter[weakest], e.value[j],
                       sigma0 * std::sqrt(e.cov(j, j)), false});
    const Eigen::VectorXd q = e.cov.col(j);
    const double q_jj = q[j];
    e.value -= q * (e.value[j] / q_jj);
    e.cov -= q * q.transpose() / q_jj;
    e.out[weakest] = true;
  }
  HoldAtStart(network, dispersion, dropped);
  return dropped;
}

std::vector<DroppedParameter> HoldUndetermined(Network* network, const Dispersion& dispersion,
                                               double sigma0) {
  std::vector<DroppedParameter> held;
  for (std::size_t c = 0; c < network->cameras.size(); ++c) {
    const NetworkCamera& camera = network->cameras[c];
    const double side = std::max(camera.camera.width_px, camera.camera.height_px);
    DroppedParameter worst;
    double largest = 1.0;
    for (const int k : {kF, kX0, kY0}) {
      const int u = dispersion.index().camera[c][k];
      if (u < 0) continue;
      const double sigma = sigma0 * std::sqrt(dispersion.Covariance({u}, {u})(0, 0));
      const double ratio = sigma / (k == kF ? 0.1 * camera.camera.f_px() : 0.25 * side);
      if (ratio <= largest) continue;
      largest = ratio;
      worst = {static_cast<int>(c), k, camera.camera.interior[k], sigma, true};
    }
    if (worst.undetermined) held.push_back(worst);
  }
  HoldAtStart(network, dispersion, held);
  return held;
}

}  // namespace videogrammetry
