"""Writes the small HDF5 files of the tests with h5py and PyTables: types, byte orders and
compression that the crate's own library would not write. Row i holds frame = i // 2,
x = i / 4, y = 100 - i / 8, photons = 50 i, good = (i % 3 == 0).
usage: write.py FOLDER  (needs h5py, tables, hdf5plugin)"""
import os, sys
import h5py, hdf5plugin, numpy as np, tables

folder = sys.argv[1]
N = 40
i = np.arange(N)


def fill(dtype):
    rows = np.zeros(N, dtype)
    rows['frame'], rows['x'], rows['y'], rows['photons'] = i // 2, i / 4, 100 - i / 8, 50 * i
    rows['good'] = i % 3 == 0
    return rows


plain = [('frame', '<u4'), ('x', '<f4'), ('y', '<f4'), ('photons', '<f4'), ('good', '?')]
swapped = [('frame', '>i2'), ('x', '>f8'), ('y', '>f4'), ('photons', '<f2'), ('good', '?')]
packings = {
    'gzip': dict(compression='gzip', shuffle=True, chunks=(16,)),
    'gzip_only': dict(compression='gzip', chunks=(16,)),
    'lzf': dict(compression='lzf', chunks=(16,)),
    'fletcher': dict(compression='gzip', shuffle=True, fletcher32=True, chunks=(16,)),
    'bzip2': dict(compression=hdf5plugin.BZip2(), chunks=(16,)),
    'blosc2': dict(compression=hdf5plugin.Blosc2(), chunks=(16,)),
    'zstd': dict(compression=hdf5plugin.Zstd(), chunks=(16,)),
}


def h5py_file(name, rows, userblock=0, **how):
    with h5py.File(os.path.join(folder, name), 'w', libver='latest', userblock_size=userblock) as f:
        f.create_dataset('locs', data=rows, **how)


h5py_file('swapped_locs.hdf5', fill(swapped))
h5py_file('userblock_locs.hdf5', fill(plain), userblock=512)
h5py_file('userblock_gzip_locs.hdf5', fill(plain), userblock=1024, **packings['gzip'])
for name, how in packings.items():
    h5py_file(f'{name}_locs.hdf5', fill(plain), **how)
for lib in ('blosclz', 'lz4', 'zlib', 'zstd'):
    filters = tables.Filters(complevel=5, complib=f'blosc:{lib}', shuffle=True)
    with tables.open_file(os.path.join(folder, f'blosc_{lib}_locs.hdf5'), 'w', filters=filters) as f:
        f.create_table('/', 'locs', fill(plain), chunkshape=(16,))

example = np.zeros(4, [(c, '<u4' if c == 'frame' else '<f4')
                       for c in 'frame x y photons sx sy bg lpx lpy'.split()])
example['frame'] = 0, 0, 1, 3
example['x'], example['y'] = (10.25, 12.5, 10.5, 31.75), (4.5, 20, 4.75, 8.125)
example['photons'], example['bg'] = (1000, 2000, 1500, 800), 5
example['sx'] = example['sy'] = 1.25
example['lpx'] = example['lpy'] = .0625
h5py_file('example_locs.hdf5', example)
