// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/read_bytes.h>
#include <spng.h>

#include <cstdlib>
#include <cstring>
#include <random>

#include "io/png_unfilter.h"
#include "temporary_folder.h"

namespace kys_slam {
namespace {

template <typename T>
ImageOf<T> random_image(int width, int height) {
  std::mt19937 generator(7);
  ImageOf<T> image(width, height);
  auto* bytes = reinterpret_cast<std::uint8_t*>(image.data());
  for (std::size_t i = 0; i < image.size() * sizeof(T); ++i) {
    bytes[i] = static_cast<std::uint8_t>(i / 5 + generator() % 9);
  }
  return image;
}

/// A PNG made by libspng's encoder, of any kind.
std::vector<std::uint8_t> make_png(spng_ihdr header, const std::vector<std::uint8_t>& data,
                                   int filters, const spng_plte* palette = nullptr) {
  spng_ctx* context = spng_ctx_new(SPNG_CTX_ENCODER);
  spng_set_option(context, SPNG_ENCODE_TO_BUFFER, 1);
  spng_set_option(context, SPNG_FILTER_CHOICE, filters);
  spng_set_ihdr(context, &header);
  if (palette != nullptr) {
    spng_plte copy = *palette;
    spng_set_plte(context, &copy);
  }
  EXPECT_EQ(
      spng_encode_image(context, data.data(), data.size(), SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE), 0);
  std::size_t size = 0;
  int error = 0;
  void* buffer = spng_get_png_buffer(context, &size, &error);
  const auto* bytes = static_cast<std::uint8_t*>(buffer);
  std::vector<std::uint8_t> png(bytes, bytes + size);
  std::free(buffer);
  spng_ctx_free(context);
  return png;
}

TEST(ImageIo, EveryKindSurvivesWritingAndReading) {
  const TemporaryFolder folder;
  const auto path = folder / "image.png";
  const auto gray = random_image<std::uint8_t>(37, 23);
  write_png(path, gray);
  EXPECT_EQ(read_gray(path), gray);
  EXPECT_EQ(read_indexed(path), gray);
  const auto rgb = random_image<RgbPixel>(37, 23);
  write_png(path, rgb);
  EXPECT_EQ(read_rgb(path), rgb);
  const auto u16 = random_image<std::uint16_t>(37, 23);
  write_png(path, u16);
  EXPECT_EQ(read_u16(path), u16);
  const auto rgb16 = random_image<Rgb16Pixel>(37, 23);
  write_png(path, rgb16);
  EXPECT_EQ(read_rgb16(path), rgb16);
  EXPECT_EQ(read_image_info(path).bits, 16);
}

TEST(ImageIo, EveryRowFilterAndPixelSizeIsUndone) {
  const int filters[] = {SPNG_FILTER_CHOICE_NONE, SPNG_FILTER_CHOICE_SUB, SPNG_FILTER_CHOICE_UP,
                         SPNG_FILTER_CHOICE_AVG, SPNG_FILTER_CHOICE_PAETH};
  for (const int filter : filters) {
    for (const int bits : {8, 16}) {
      for (const int color : {0, 2}) {
        const auto pixels = random_image<std::uint8_t>(31 * (color == 2 ? 3 : 1) * bits / 8, 17);
        std::vector<std::uint8_t> data(pixels.data(), pixels.data() + pixels.size());
        const spng_ihdr header{31, 17, std::uint8_t(bits), std::uint8_t(color), 0, 0, 0};
        const auto png = make_png(header, data, filter);
        const void* decoded = nullptr;
        GrayImage gray;
        RgbImage rgb;
        Image16 u16;
        Rgb16Image rgb16;
        if (color == 0 && bits == 8) decoded = (gray = decode_gray(png, "x")).data();
        if (color == 2 && bits == 8) decoded = (rgb = decode_rgb(png, "x")).data();
        if (color == 0 && bits == 16) decoded = (u16 = decode_u16(png, "x")).data();
        if (color == 2 && bits == 16) decoded = (rgb16 = decode_rgb16(png, "x")).data();
        EXPECT_EQ(std::memcmp(decoded, data.data(), data.size()), 0) << filter << " " << bits;
      }
    }
  }
}

TEST(ImageIo, UnfilterFirstRowAverage) {
  const std::uint8_t in[4] = {10, 10, 10, 250};
  std::uint8_t out[4];
  ASSERT_TRUE(png_unfilter_row(3, in, nullptr, 4, 1, out));
  EXPECT_EQ(out[0], 10);
  EXPECT_EQ(out[1], 15);
  EXPECT_EQ(out[2], 17);
  EXPECT_EQ(out[3], 2);  // 250 + 8 modulo 256
  EXPECT_FALSE(png_unfilter_row(5, in, nullptr, 4, 1, out));
}

TEST(ImageIo, IndexedGivesTheIndexAndColourItsPalette) {
  spng_plte palette{};
  palette.n_entries = 16;
  for (std::uint8_t i = 0; i < 16; ++i) palette.entries[i] = {i, std::uint8_t(2 * i), 7, 0};
  // 4-bit indices, 3 pixels a row: 1 2 3 / 15 0 4
  const auto png = make_png({3, 2, 4, SPNG_COLOR_TYPE_INDEXED, 0, 0, 0}, {0x12, 0x30, 0xf0, 0x40},
                            SPNG_FILTER_CHOICE_NONE, &palette);
  const auto index = decode_indexed(png, "x");
  EXPECT_EQ(index.at(0, 0), 1);
  EXPECT_EQ(index.at(2, 0), 3);
  EXPECT_EQ(index.at(0, 1), 15);
  EXPECT_EQ(index.at(2, 1), 4);
  EXPECT_EQ(decode_rgb(png, "x").at(0, 1), (RgbPixel{15, 30, 7}));
}

TEST(ImageIo, GreyFromColourIsLuma) {
  const TemporaryFolder folder;
  write_png(folder / "c.png", RgbImage(2, 2, {255, 0, 0}));
  EXPECT_EQ(read_gray(folder / "c.png").at(1, 1), 76);
  write_png(folder / "c.png", Image16(2, 2, 0x1234));
  EXPECT_EQ(read_gray(folder / "c.png").at(0, 0), 0x12);
}

TEST(ImageIo, EveryTruncationAndEveryFlippedByteOfImageDataIsRefused) {
  const TemporaryFolder folder;
  write_png(folder / "i.png", random_image<std::uint8_t>(40, 30));
  const auto png = read_bytes(folder / "i.png");
  for (std::size_t n = 0; n < png.size(); ++n) {
    EXPECT_THROW(decode_gray(std::span(png).first(n), "i.png"), InputError) << n;
  }
  for (std::size_t i = 8; i + 12 < png.size(); ++i) {
    auto bad = png;
    bad[i] ^= 0x5a;
    EXPECT_THROW(decode_gray(bad, "i.png"), InputError) << i;
  }
}

TEST(ImageIo, HostileSizesAreRefusedBeforeAllocation) {
  const TemporaryFolder folder;
  expect_input_error(
      [] {
        decode_gray(make_png({20000, 1, 8, 0, 0, 0, 0}, std::vector<std::uint8_t>(20000, 1),
                             SPNG_FILTER_CHOICE_NONE),
                    "wide.png");
      },
      {"wide.png", "20000x1"});
}

TEST(ImageIo, MessagesNameTheFile) {
  const TemporaryFolder folder;
  expect_input_error([&] { read_gray(folder / "none.png"); }, {"none.png", "cannot read"});
  write_text(folder / "text.png", "hello, world");
  expect_input_error([&] { read_gray(folder / "text.png"); }, {"text.png", "neither"});
  write_text(folder / "empty.png", "");
  expect_input_error([&] { read_gray(folder / "empty.png"); }, {"empty.png", "empty"});
  expect_input_error([&] { read_gray(folder.path()); }, {"not a regular file"});
  write_png(folder / "g.png", GrayImage(4, 4));
  expect_input_error([&] { read_u16(folder / "g.png"); }, {"g.png", "16-bit grey"});
  expect_input_error([&] { write_png(folder / "no/such/x.png", GrayImage(4, 4)); },
                     {"cannot write", "x.png"});
}

TEST(ImageIo, JpegAndItsTruncation) {
  const auto data = shared_data() / "euroc_v101_keyframes/mav0/cam0/data/1403715273262142976.jpg";
  if (!std::filesystem::exists(data)) GTEST_SKIP() << "no " << data;
  const auto jpeg = read_bytes(data);
  const auto gray = decode_gray(jpeg, "j.jpg");
  EXPECT_EQ(gray.width(), 752);
  EXPECT_EQ(gray.height(), 480);
  EXPECT_EQ(decode_rgb(jpeg, "j.jpg").at(100, 100)[1], gray.at(100, 100));
  for (const std::size_t n : {std::size_t{10}, std::size_t{300}, jpeg.size() / 2}) {
    expect_input_error([&] { decode_gray(std::span(jpeg).first(n), "j.jpg"); }, {"j.jpg"});
  }
}

}  // namespace
}  // namespace kys_slam
