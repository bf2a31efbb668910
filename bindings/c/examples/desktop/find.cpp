// Finds an object in pictures: learns it from the first, and prints its outline in each of the others.
//
//   find OBJECT.ppm PICTURE.ppm...      binary PPM or PGM, of at most 640 x 480 px
//
// Exit status: 0 if the object is in every picture, 1 if not, 2 if something could not be done.
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "keygraph.h"

namespace {

struct Picture {
    std::vector<unsigned char> pixels;
    std::uint32_t width = 0, height = 0;
    kg_format format = KG_FORMAT_RGB8;

    kg_frame frame() const {
        kg_frame f{};
        f.data = pixels.data();
        f.bytes = pixels.size();
        f.format = format;
        f.width = width;
        f.height = height;
        return f;
    }
};

void must(kg_status status, const std::string &what) {
    if (status < 0) {
        throw std::runtime_error(what + ": " + kg_status_text(status));
    }
}

// Reads a number of the header of a PPM file. Comments run to the end of their line.
std::uint32_t number(std::istream &in) {
    while (std::isspace(in.peek()) || in.peek() == '#') {
        if (in.get() == '#') {
            std::string comment;
            std::getline(in, comment);
        }
    }
    std::uint32_t n = 0;
    in >> n;
    return n;
}

Picture read(const std::string &path) {
    std::ifstream in(path, std::ios::binary);
    std::string kind(2, '\0');
    in.read(&kind[0], 2);
    Picture p;
    p.width = number(in);
    p.height = number(in);
    const std::uint32_t most = number(in);
    in.get();
    const bool known = kind == "P6" || kind == "P5";
    if (!in || !known || most != 255 || p.width > 640 || p.height > 640) {
        throw std::runtime_error(path + ": this is no binary PPM or PGM of 8 bits and at most 640 px a side");
    }
    p.format = kind == "P6" ? KG_FORMAT_RGB8 : KG_FORMAT_GRAY8;
    std::size_t bytes = 0;
    must(kg_frame_bytes(p.format, p.width, p.height, 0, &bytes), path);
    p.pixels.resize(bytes);
    in.read(reinterpret_cast<char *>(p.pixels.data()), static_cast<std::streamsize>(bytes));
    if (!in) {
        throw std::runtime_error(path + ": the file is cut off");
    }
    return p;
}

// Memory for an object of the library: operator new aligns to what KG_ALIGNMENT asks for.
std::unique_ptr<unsigned char[]> memory(std::size_t bytes) {
    static_assert(KG_ALIGNMENT <= __STDCPP_DEFAULT_NEW_ALIGNMENT__, "this needs an aligned new");
    return std::unique_ptr<unsigned char[]>(new unsigned char[bytes]);
}

std::vector<unsigned char> learn(const std::string &path) {
    const Picture picture = read(path);
    const auto place = memory(KG_VGA_TRAINER_BYTES);
    kg_trainer *trainer = nullptr;
    must(kg_trainer_init(place.get(), KG_VGA_TRAINER_BYTES, KG_PROFILE_VGA, &trainer), "trainer");
    std::vector<unsigned char> model(512 << 10);
    kg_training training{};
    training.name = "object";
    training.preset = KG_PRESET_COMPACT;
    const kg_frame frame = picture.frame();
    kg_trained trained{};
    must(kg_trainer_train(trainer, &frame, &training, model.data(), model.size(), &trained), path);
    model.resize(trained.bytes);
    std::printf("%s: %u keypoints, %u keygraphs, %zu bytes\n", path.c_str(), trained.keypoints, trained.keygraphs,
                trained.bytes);
    return model;
}

// Prints what is found in a picture, and returns how much that is.
std::size_t find(kg_detector *detector, const kg_model *model, const std::string &path) {
    const Picture picture = read(path);
    const kg_frame frame = picture.frame();
    must(kg_detector_detect(detector, model, &frame, nullptr, nullptr), path);
    kg_detection found[KG_DETECTIONS];
    std::size_t count = 0;
    must(kg_detector_detections(detector, found, KG_DETECTIONS, &count), path);
    std::printf("%s: %zu found\n", path.c_str(), count);
    for (std::size_t i = 0; i < count; i++) {
        kg_object object;
        must(kg_model_object(model, found[i].object, &object), path);
        std::printf("  %s, score %.3f, outline", object.name, static_cast<double>(found[i].score));
        for (const auto &corner : found[i].outline) {
            std::printf(" (%.1f, %.1f)", static_cast<double>(corner[0]), static_cast<double>(corner[1]));
        }
        std::printf("\n");
    }
    return count;
}

} // namespace

int main(int argc, char **argv) try {
    if (argc < 3) {
        std::cerr << "usage: find OBJECT.ppm PICTURE.ppm...\n";
        return 2;
    }
    const std::vector<unsigned char> bytes = learn(argv[1]);
    kg_model model;
    must(kg_model_open(&model, bytes.data(), bytes.size()), "model");
    const auto place = memory(KG_VGA_DETECTOR_BYTES);
    kg_detector *detector = nullptr;
    must(kg_detector_init(place.get(), KG_VGA_DETECTOR_BYTES, KG_PROFILE_VGA, &detector), "detector");
    bool all = true;
    for (int i = 2; i < argc; i++) {
        all = find(detector, &model, argv[i]) > 0 && all;
    }
    return all ? 0 : 1;
} catch (const std::exception &e) {
    std::cerr << e.what() << "\n";
    return 2;
}
