"""Draws the pictures of the pages on surfaces: shade.py RESULTS OUT

RESULTS holds what `puncta run docs/recipes/surface.toml --out RESULTS` wrote: cloud.csv,
extracted.ply and curved.ply (binary, low byte first). Views are along -z, x to the right, y up.
Nothing but Python is needed."""
import csv, math, struct, sys, zlib

WIDTH = 640
TYPES = {'char': 'b', 'uchar': 'B', 'short': 'h', 'ushort': 'H', 'int': 'i', 'uint': 'I', 'float': 'f',
         'double': 'd', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H', 'int32': 'i', 'uint32': 'I',
         'float32': 'f', 'float64': 'd'}


def read_ply(path):
    """Columns of the vertices by name, and triangles."""
    data = open(path, 'rb').read()
    end = data.index(b'end_header\n') + 11
    columns, count, part = [], {}, None
    for line in data[:end].decode().splitlines():
        words = line.split()
        if words[0] == 'element':
            part = words[1]
            count[part] = int(words[2])
        elif words[0] == 'property' and part == 'vertex':
            columns.append((words[2], TYPES[words[1]]))
        elif words[0] == 'property' and words[1] == 'list':
            lists = TYPES[words[2]], TYPES[words[3]]
    row = struct.Struct('<' + ''.join(code for _, code in columns))
    rows = [row.unpack_from(data, end + i * row.size) for i in range(count['vertex'])]
    values = {name: [r[i] for r in rows] for i, (name, _) in enumerate(columns)}
    face = struct.Struct('<' + lists[0] + 3 * lists[1])
    begin = end + row.size * len(rows)
    return values, [face.unpack_from(data, begin + i * face.size)[1:] for i in range(count['face'])]


def colour(t):
    """Blue at -1, light grey at 0, red at 1."""
    t = max(-1.0, min(1.0, t))
    end = (178, 24, 43) if t > 0 else (33, 102, 172)
    return [236 + (e - 236) * abs(t) for e in end]


class Picture:
    def __init__(self, low, high):
        self.scale = (WIDTH - 40) / (high[0] - low[0])
        self.low, self.height = low, int((high[1] - low[1]) * self.scale) + 40
        self.pixels = [[(255, 255, 255)] * WIDTH for _ in range(self.height)]
        self.depth = [[-math.inf] * WIDTH for _ in range(self.height)]

    def place(self, p):
        return 20 + (p[0] - self.low[0]) * self.scale, self.height - 20 - (p[1] - self.low[1]) * self.scale, p[2]

    def dot(self, p, shade):
        x, y, _ = self.place(p)
        if 0 <= int(x) < WIDTH and 0 <= int(y) < self.height:
            old = self.pixels[int(y)][int(x)]
            self.pixels[int(y)][int(x)] = tuple(c * (1 - shade) for c in old)

    def triangle(self, corners, colours):
        a, b, c = corners
        u, v = [b[i] - a[i] for i in range(3)], [c[i] - a[i] for i in range(3)]
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        size = math.sqrt(sum(x * x for x in n))
        if size == 0 or n[2] <= 0:
            return
        light = 0.35 + 0.65 * max(0.0, (-0.4 * n[0] + 0.5 * n[1] + 0.77 * n[2]) / size)
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = map(self.place, corners)
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            return
        for y in range(max(0, int(min(ay, by, cy))), min(self.height - 1, int(max(ay, by, cy)) + 1) + 1):
            for x in range(max(0, int(min(ax, bx, cx))), min(WIDTH - 1, int(max(ax, bx, cx)) + 1) + 1):
                wb = ((x + 0.5 - ax) * (cy - ay) - (cx - ax) * (y + 0.5 - ay)) / area
                wc = ((bx - ax) * (y + 0.5 - ay) - (x + 0.5 - ax) * (by - ay)) / area
                wa = 1 - wb - wc
                if min(wa, wb, wc) < -1e-9:
                    continue
                z = wa * az + wb * bz + wc * cz
                if z > self.depth[y][x]:
                    self.depth[y][x] = z
                    mixed = [wa * i + wb * j + wc * k for i, j, k in zip(*colours)]
                    self.pixels[y][x] = tuple(light * m for m in mixed)

    def write(self, path):
        # Fewer shades, so that the file is small.
        rows = b''.join(b'\0' + bytes(min(255, 6 * round(c / 6)) for p in row for c in p) for row in self.pixels)
        def chunk(kind, body):
            return struct.pack('>I', len(body)) + kind + body + struct.pack('>I', zlib.crc32(kind + body))
        head = struct.pack('>IIBBBBB', WIDTH, self.height, 8, 2, 0, 0, 0)
        with open(path, 'wb') as file:
            file.write(b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', head) + chunk(b'IDAT', zlib.compress(rows, 9)) + chunk(b'IEND', b''))


def main(results, out):
    surface, triangles = read_ply(f'{results}/extracted.ply')
    points = list(zip(surface['x'], surface['y'], surface['z']))
    low = [min(p[i] for p in points) - 10 for i in range(3)]
    high = [max(p[i] for p in points) + 10 for i in range(3)]

    cloud = Picture(low, high)
    for row in csv.DictReader(open(f'{results}/cloud.csv')):
        values = {name.split('[')[0].split('(')[0].strip(): value for name, value in row.items()}
        cloud.dot([float(values[axis]) for axis in 'xyz'], 0.35)
    cloud.write(f'{out}/cloud.png')

    extracted = Picture(low, high)
    grey = [colour(0)] * 3
    for t in triangles:
        extracted.triangle([points[v] for v in t], grey)
    extracted.write(f'{out}/extracted.png')

    curved, triangles = read_ply(f'{results}/curved.ply')
    points = list(zip(curved['x'], curved['y'], curved['z']))
    shades = [colour(h / 0.03) for h in curved['curvature_mean']]
    picture = Picture(low, high)
    for t in triangles:
        picture.triangle([points[v] for v in t], [shades[v] for v in t])
    picture.write(f'{out}/curvature.png')


main(*sys.argv[1:])
