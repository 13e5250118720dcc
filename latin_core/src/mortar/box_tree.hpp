#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::mortar {

using Box = Eigen::AlignedBox3d;

/// Boxes in a tree: those that touch a given one are found without looking at all.
class BoxTree {
 public:
  explicit BoxTree(std::vector<Box> boxes);

  /// Numbers of the boxes that touch a box, ascending.
  void touching(const Box& box, std::vector<Index>& found) const;

 private:
  struct Node {
    Box box;
    Index begin;  ///< of its members
    Index end;
    Index second;  ///< its second half, the first one follows it; 0: a leaf
  };
  void build(Index begin, Index end);

  std::vector<Box> boxes_;
  std::vector<Index> members_;
  std::vector<Node> nodes_;
};

}  // namespace latin::mortar
