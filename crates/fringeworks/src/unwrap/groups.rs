//! Disjoint sets of pixels with fringe orders relative to each other (union–find).

/// Disjoint sets; every entry has a fringe order relative to its parent.
pub struct Groups {
    parent: Vec<u32>,
    /// Order relative to the parent.
    order: Vec<i32>,
    /// Number of pixels of a root's set.
    size: Vec<u32>,
}

impl Groups {
    /// One set per entry, of so many pixels each.
    pub fn new(size: Vec<u32>) -> Self {
        Self {
            parent: (0..size.len() as u32).collect(),
            order: vec![0; size.len()],
            size,
        }
    }

    /// Make `n` sets of one pixel each.
    pub fn reset(&mut self, n: usize) {
        self.parent.clear();
        self.parent.extend(0..n as u32);
        self.order.clear();
        self.order.resize(n, 0);
        self.size.clear();
        self.size.resize(n, 1);
    }

    /// Root of `i`, and the order of `i` relative to the root. Halves the path to the root.
    #[inline]
    pub fn find(&mut self, mut i: usize) -> (usize, i32) {
        let mut total = 0;
        loop {
            let parent = self.parent[i] as usize;
            if parent == i {
                return (i, total);
            }
            let above = self.parent[parent] as usize;
            if above != parent {
                self.order[i] += self.order[parent];
                self.parent[i] = above as u32;
            }
            total += self.order[i];
            i = above;
        }
    }

    pub fn size(&self, root: usize) -> u32 {
        self.size[root]
    }

    /// Unite the sets of the roots `a` and `b` so that order(b) − order(a) = `shift`. Returns the new
    /// root.
    #[inline]
    pub fn unite(&mut self, a: usize, b: usize, shift: i32) -> usize {
        let (root, leaf, shift) = if self.size[a] >= self.size[b] {
            (a, b, shift)
        } else {
            (b, a, -shift)
        };
        self.parent[leaf] = root as u32;
        self.order[leaf] = shift;
        self.size[root] += self.size[leaf];
        root
    }

    /// Join the sets of `a` and `b` so that order(b) − order(a) = `step`.
    pub fn join(&mut self, a: usize, b: usize, step: i32) {
        let (root_a, order_a) = self.find(a);
        let (root_b, order_b) = self.find(b);
        if root_a != root_b {
            self.unite(root_a, root_b, order_a + step - order_b);
        }
    }

    /// Order of every entry relative to its root, and the number of its set; 1 is the largest.
    pub fn labelled(&mut self) -> (Vec<i32>, Vec<u32>) {
        let n = self.parent.len();
        let mut roots: Vec<usize> = (0..n).filter(|i| self.parent[*i] as usize == *i).collect();
        roots.sort_by_key(|i| (std::cmp::Reverse(self.size[*i]), *i));
        let mut number = vec![0u32; n];
        for (k, root) in roots.iter().enumerate() {
            number[*root] = k as u32 + 1;
        }
        (0..n)
            .map(|i| {
                let (root, order) = self.find(i);
                (order, number[root])
            })
            .unzip()
    }
}
