"""Declares photographs of surfaces in packages of others: files by checksum, authors, licences."""

from collections.abc import Mapping
from dataclasses import dataclass

from advercity_dsl.catalogue import FreeLicence

from advercity.digests import compute_json_digest


@dataclass(frozen=True)
class TextureFile:
    """An image in a package.

    Attributes:
        path: Its path in the package.
        sha256: Its SHA-256.
    """

    path: str
    sha256: str


@dataclass(frozen=True)
class PhotographedSurface:
    """A surface of which a package has photographs.

    Attributes:
        material: Material whose albedo and roughness the images get on average.
        tile_m: Width of the images on the surface.
        color: Photograph, sRGB; its opacity, if it has one, cuts out leaves.
        normal: Normals with y up, or none.
        roughness: Roughness, or none.
    """

    material: str
    tile_m: float
    color: TextureFile
    normal: TextureFile | None = None
    roughness: TextureFile | None = None

    @property
    def files(self) -> dict[str, TextureFile]:
        """Files by kind of image."""
        files = {"color": self.color, "normal": self.normal, "roughness": self.roughness}
        return {kind: file for kind, file in files.items() if file is not None}


@dataclass(frozen=True)
class TexturePack:
    """The used files of one version of an npm package.

    Attributes:
        name: Name in specs.
        package: Name of the package.
        version: Its version.
        sha256: SHA-256 of the package file.
        size_bytes: Its size.
        author: Author according to the package.
        licence: Licence according to the package.
        notice: File with the text of the licence.
        surfaces: Surfaces by name.
    """

    name: str
    package: str
    version: str
    sha256: str
    size_bytes: int
    author: str
    licence: FreeLicence
    notice: TextureFile
    surfaces: Mapping[str, PhotographedSurface]

    @property
    def asset(self) -> str:
        """Name among the assets of specs."""
        return f"textures/{self.name}"

    @property
    def files(self) -> list[TextureFile]:
        """All used files."""
        images = [file for surface in self.surfaces.values() for file in surface.files.values()]
        return [self.notice, *images]

    @property
    def digest(self) -> str:
        """SHA-256 of the checksums of all images by surface: the pack's record in specs."""
        return compute_json_digest(
            {
                name: {kind: file.sha256 for kind, file in surface.files.items()}
                for name, surface in self.surfaces.items()
            }
        )


EZ_TREE = TexturePack(
    name="ez_tree",
    package="@dgreenheck/ez-tree",
    version="1.1.0",
    sha256="4147b49d22b01f09c9d7f3c3c34f788ad37841103a758da25e399af3cbce2f98",
    size_bytes=19_478_340,
    author="Daniel Greenheck",
    licence="MIT",
    notice=TextureFile(
        "LICENSE", "20e4afadfb10c67952b3d73cd2982d21d165ab4ae82b0dd9e4d6f2166ee349b6"
    ),
    surfaces={
        "bark": PhotographedSurface(
            "bark",
            1.0,
            TextureFile(
                "src/lib/assets/bark/willow_color_1k.jpg",
                "25d93112579146c55fa51cbf9749ef1de36a97f7620b9f5dc4ce5f5a9ab0f04e",
            ),
            TextureFile(
                "src/lib/assets/bark/willow_normal_1k.jpg",
                "695cdc3ef35b89ad6718b80f9e7e365efdd546e03f411594deb26683b0f41530",
            ),
            TextureFile(
                "src/lib/assets/bark/willow_roughness_1k.jpg",
                "81892cd29f186af5605385ae00cecd120fa3a87d43d18eb9d4ccc0b986accc7a",
            ),
        ),
        "bark_oak": PhotographedSurface(
            "bark",
            1.0,
            TextureFile(
                "src/lib/assets/bark/oak_color_1k.jpg",
                "053794dc9d3d5c39fc00f2d0f0fc5f6f5c9b81b58c016af26c4aba0335d01722",
            ),
            TextureFile(
                "src/lib/assets/bark/oak_normal_1k.jpg",
                "91c8e6166e47876b213c59207cc3addecec5c1303509960cd81167e6c48984a1",
            ),
            TextureFile(
                "src/lib/assets/bark/oak_roughness_1k.jpg",
                "e24b8ca0304ab42f025561646576031aaf9e2919f57582d85033e29e78054b61",
            ),
        ),
        "bark_pine": PhotographedSurface(
            "bark",
            1.0,
            TextureFile(
                "src/lib/assets/bark/pine_color_1k.jpg",
                "01389d2297e901a583d3d3f824c829689fce8afcffcb0eaabcb666688a781e70",
            ),
            TextureFile(
                "src/lib/assets/bark/pine_normal_1k.jpg",
                "f60be6b239e2a8aeb63dfb78d62a88c6ee05b241d78b69c197ff429eefb080d3",
            ),
            TextureFile(
                "src/lib/assets/bark/pine_roughness_1k.jpg",
                "85b9fa99b700bbb629c90cee5deeebec78fef7cd40443aa361f5edb090fd3341",
            ),
        ),
        "leaves_ash": PhotographedSurface(
            "leaves",
            0.5,
            TextureFile(
                "src/lib/assets/leaves/ash_color.png",
                "5ec987db3829a839856c32c79b18a33a78f209e911cad55c65abfb77f30e2d29",
            ),
        ),
        "leaves_oak": PhotographedSurface(
            "leaves",
            0.5,
            TextureFile(
                "src/lib/assets/leaves/oak_color.png",
                "24451223cf396d22910a4932b8bb996a7274e63d81e24128c96a430ab67822b1",
            ),
        ),
        "leaves_pine": PhotographedSurface(
            "needles",
            0.5,
            TextureFile(
                "src/lib/assets/leaves/pine_color.png",
                "88be36a2387554ac4b7c7d1549eae454a37ad896e8e33a7d6ae5956bd169ab08",
            ),
        ),
        "soil": PhotographedSurface(
            "soil",
            2.0,
            TextureFile(
                "src/app/public/dirt_color.jpg",
                "3b351b84a58976fab734d295fb164f87fb00507e73c095a8b3c6766e3d12684a",
            ),
            TextureFile(
                "src/app/public/dirt_normal.jpg",
                "2556aa1200aff376017a339cb3496f1319d0a84d58824f220d6f7c033eb4c3ca",
            ),
        ),
    },
)

TEXTURE_PACKS: dict[str, TexturePack] = {pack.asset: pack for pack in (EZ_TREE,)}
"""Packs by their name among the assets of specs."""
